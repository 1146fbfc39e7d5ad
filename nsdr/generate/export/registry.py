"""The formats by name, and the run that writes one."""

import logging
from dataclasses import asdict

from nsdr.clevrer.files.schema import get
from nsdr.errors import DataError
from nsdr.generate.export.base import Export, ExportConfig, Exporter, SplitSummary
from nsdr.io.files import check_installed, check_output_folder, locked, remove_partial_files, write_json
from nsdr.io.reading import read_json
from nsdr.io.registry import Registry

__all__ = ["EXPORTERS", "export_dataset"]

MANIFEST = "export.json"
"""File of an export's folder with its settings and counts."""
log = logging.getLogger(__name__)

EXPORTERS: Registry[Exporter] = Registry(
    "export format",
    "nsdr.exporters",
    {
        "grpo": "nsdr.generate.export.grpo:GRPO",
        "chat": "nsdr.generate.export.chat:CHAT",
        "parquet": "nsdr.generate.export.parquet:PARQUET",
        "webdataset": "nsdr.generate.export.webdataset:WEBDATASET",
    },
)
"""Formats by name; another package adds one by an entry point of the group `nsdr.exporters`."""


def export_dataset(config: ExportConfig) -> dict[str, SplitSummary]:
    """Write an export; a finished one is left as it is, an interrupted one is finished.

    Returns:
        What it holds of each split.

    Raises:
        DataError: an unknown format, its package is not installed, a split has no questions, a video is missing, or the folder
            holds other files, an export with other settings or one of other data.
    """
    exporter = EXPORTERS[config.format]
    if exporter.needs:
        check_installed(exporter.needs, f"format {config.format} needs {exporter.needs}", exporter.needs)
    if config.videos not in exporter.videos:
        expected = " or ".join(exporter.videos)
        raise DataError(f"videos: {config.videos} is not possible with format {config.format}; expected {expected}")
    if config.scenes and exporter.videos == ("copy",):
        raise DataError(f"scenes: format {config.format} holds videos and questions only; leave out --scenes")
    check_output_folder(config.output)
    export = Export(config)
    with locked(export.folder):
        _write(export, exporter)
    for name, summary in export.splits.items():
        if summary.unanswered:
            log.warning(
                "%s: %d of %d questions have no answer in their file and were exported without a solution",
                name,
                summary.unanswered,
                summary.questions,
            )
    return export.splits


def _write(export: Export, exporter: Exporter) -> None:
    path = export.folder / MANIFEST
    manifest = {
        "settings": export.settings(),
        "splits": {name: asdict(summary) for name, summary in export.splits.items()},
    }
    if path.exists():
        existing = get(read_json(path), "settings", dict, str(path))
        changed = sorted(k for k, v in manifest["settings"].items() if existing.get(k) != v)
        if changed:
            raise DataError(f"{path}: was made with other settings ({', '.join(changed)}); choose another folder")
        if read_json(path).get("complete"):
            return
        remove_partial_files(export.folder)
    elif any(not file.name.startswith(".") for file in export.folder.iterdir()):
        raise DataError(f"{export.folder}: holds files that are no export; choose an empty or new folder")
    write_json(path, manifest | {"complete": False}, indent=1)
    exporter.write(export)
    write_json(path, manifest | {"complete": True}, indent=1)
