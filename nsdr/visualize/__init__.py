"""Images, videos and HTML reports that show what each stage found and why a question got its answer."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.visualize.annotate import annotated_image, write_annotated_image
    from nsdr.visualize.comparison import comparison_frames
    from nsdr.visualize.distributions import program_curve, question_figure, training_curves
    from nsdr.visualize.figures import causal_figure, figure_png, plan_figure
    from nsdr.visualize.report import write_report
    from nsdr.visualize.samples import sample_image
    from nsdr.visualize.strobe import stroboscopic_image
    from nsdr.visualize.video import write_annotated_video

_HOME = {
    "nsdr.visualize.annotate": ["annotated_image", "write_annotated_image"],
    "nsdr.visualize.comparison": ["comparison_frames"],
    "nsdr.visualize.distributions": ["program_curve", "question_figure", "training_curves"],
    "nsdr.visualize.figures": ["causal_figure", "figure_png", "plan_figure"],
    "nsdr.visualize.samples": ["sample_image"],
    "nsdr.visualize.strobe": ["stroboscopic_image"],
    "nsdr.visualize.video": ["write_annotated_video"],
    "nsdr.visualize.report": ["write_report"],
}

__all__ = [
    "annotated_image",
    "causal_figure",
    "comparison_frames",
    "figure_png",
    "plan_figure",
    "program_curve",
    "question_figure",
    "sample_image",
    "stroboscopic_image",
    "training_curves",
    "write_annotated_image",
    "write_annotated_video",
    "write_report",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)
