from .base import Export as Export, ExportConfig as ExportConfig, Exporter as Exporter, SplitSummary as SplitSummary
from .records import Record as Record, scene_records as scene_records
from .registry import EXPORTERS as EXPORTERS, export_dataset as export_dataset
