"""Pictures, videos and reports of what the system saw and why it answered so."""

from nsdr.visualize.picture import annotated_picture
from nsdr.visualize.report import write_report
from nsdr.visualize.strobe import stroboscopic_picture
from nsdr.visualize.video import write_annotated_video

__all__ = ["annotated_picture", "stroboscopic_picture", "write_annotated_video", "write_report"]
