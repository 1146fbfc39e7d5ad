from .annotate import (
    annotated_image as annotated_image,
    stroboscopic_image as stroboscopic_image,
    write_annotated_video as write_annotated_video,
)
from .figures import figure_png as figure_png, plan_figure as plan_figure
from .report import write_report as write_report
from .violations import write_judgements as write_judgements
