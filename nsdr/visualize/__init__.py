"""Images, videos and reports of what the system saw and why it answered so."""

from nsdr.visualize.annotate import annotated_image
from nsdr.visualize.report import write_report
from nsdr.visualize.strobe import stroboscopic_image
from nsdr.visualize.video import write_annotated_video

__all__ = ["annotated_image", "stroboscopic_image", "write_annotated_video", "write_report"]
