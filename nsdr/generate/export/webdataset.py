"""Tar files with videos and their questions, for streaming to many machines."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from nsdr.generate.export.base import Export, Exporter
from nsdr.generate.export.records import Record
from nsdr.io.files import atomic_path

BYTES_PER_MB = 10**6
MEMBER_BYTES = 2 * 512
"""What the tar format adds to a member at most: its header, and padding to the next 512 bytes."""


class _Sample(NamedTuple):
    """The files of a video: name without ending, the video, and its questions as JSON."""

    key: str
    video: Path
    questions: bytes


def _write(export: Export) -> None:
    import webdataset

    for split in export.splits:
        samples = (_sample(video, records) for video, records in export.scenes(split) if video is not None)
        for number, shard in enumerate(_shards(samples, export.config.shard_mb * BYTES_PER_MB)):
            path = export.folder / f"{split}-{number:06d}.tar"
            if path.exists():
                continue
            with (
                atomic_path(path) as temporary,
                temporary.open("wb") as file,
                webdataset.TarWriter(file, encoder=False, mtime=0) as tar,
            ):
                for sample in shard:
                    tar.write({"__key__": sample.key, "json": sample.questions, "mp4": sample.video.read_bytes()})


def _sample(video: Path, records: tuple[Record, ...]) -> _Sample:
    first = records[0]
    key = f"video_{first.scene_index:05d}"
    rows = [record.row() | {"video": f"{key}.mp4"} for record in records]
    document = {"scene_index": first.scene_index, "split": first.split, "seed": first.seed, "questions": rows}
    return _Sample(key, video, json.dumps(document).encode())


def _shards(samples: Iterator[_Sample], limit: int) -> Iterator[list[_Sample]]:
    """Groups of consecutive samples whose files stay below the limit (bytes), unless a single one is larger."""
    shard: list[_Sample] = []
    size = 0
    for sample in samples:
        added = len(sample.questions) + sample.video.stat().st_size + 2 * MEMBER_BYTES
        if shard and size + added > limit:
            yield shard
            shard, size = [], 0
        shard.append(sample)
        size += added
    if shard:
        yield shard


WEBDATASET = Exporter(_write, needs="webdataset", refuses=("--scenes", "--videos none"))
"""SPLIT-NUMBER.tar with KEY.mp4 and KEY.json of each video: `scene_index`, `split`, `seed`, and the records as `questions`."""
