"""Images, videos and HTML reports that show what each stage found and why a question got its answer."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nsdr.visualize.annotate import annotated_image, write_annotated_image
    from nsdr.visualize.figures import causal_figure, figure_png, plan_figure
    from nsdr.visualize.report import write_report
    from nsdr.visualize.strobe import stroboscopic_image
    from nsdr.visualize.video import write_annotated_video

_MODULE_OF = {
    "annotated_image": "nsdr.visualize.annotate",
    "causal_figure": "nsdr.visualize.figures",
    "figure_png": "nsdr.visualize.figures",
    "plan_figure": "nsdr.visualize.figures",
    "stroboscopic_image": "nsdr.visualize.strobe",
    "write_annotated_image": "nsdr.visualize.annotate",
    "write_annotated_video": "nsdr.visualize.video",
    "write_report": "nsdr.visualize.report",
}

__all__ = [
    "annotated_image",
    "causal_figure",
    "figure_png",
    "plan_figure",
    "stroboscopic_image",
    "write_annotated_image",
    "write_annotated_video",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'nsdr.visualize' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return __all__
