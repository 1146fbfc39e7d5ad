from .base import (
    EXPORTERS as EXPORTERS,
    Export as Export,
    ExportConfig as ExportConfig,
    Exporter as Exporter,
    SplitSummary as SplitSummary,
    export_dataset as export_dataset,
)
from .records import Record as Record, reasoner as reasoner, scene_records as scene_records
