from .formats import FORMATS as FORMATS, Format as Format, Sample as Sample, reasoner as reasoner
from .writing import ExportConfig as ExportConfig, SplitSummary as SplitSummary, export_dataset as export_dataset
