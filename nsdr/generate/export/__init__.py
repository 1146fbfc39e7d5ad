"""Data sets in CLEVRER's layout as files for training and testing other models, one file here for each format."""

from typing import TYPE_CHECKING

from nsdr.io.lazy import lazy_exports

if TYPE_CHECKING:
    from nsdr.generate.export.base import Export, ExportConfig, Exporter, SplitSummary
    from nsdr.generate.export.records import Record, scene_records
    from nsdr.generate.export.registry import EXPORTERS, export_dataset

_HOME = {
    "nsdr.generate.export.base": ["Export", "ExportConfig", "Exporter", "SplitSummary"],
    "nsdr.generate.export.records": ["Record", "scene_records"],
    "nsdr.generate.export.registry": ["EXPORTERS", "export_dataset"],
}

__all__ = [
    "EXPORTERS",
    "Export",
    "ExportConfig",
    "Exporter",
    "Record",
    "SplitSummary",
    "export_dataset",
    "scene_records",
]

__getattr__, __dir__ = lazy_exports(__name__, _HOME, __all__)
