"""Tar files with videos and their questions, for streaming to many machines."""

import json
from collections.abc import Iterator

from nsdr.generate.export.base import Export, ExportedScene, Exporter
from nsdr.io.files import atomic_path

__all__ = ["WEBDATASET"]

BYTES_PER_MB = 10**6
MEMBER_BYTES = 2 * 512
"""What the tar format adds to a member at most: its header, and padding to the next 512 bytes."""
Sample = tuple[str, bytes, ExportedScene]
"""Key, questions as JSON, and the video with its records."""


def _write(export: Export) -> None:
    import webdataset

    for split in export.splits:
        samples = (_sample(scene) for scene in export.scenes(split))
        for number, shard in enumerate(_shards(samples, export.config.shard_mb * BYTES_PER_MB)):
            path = export.folder / f"{split}-{number:06d}.tar"
            if path.exists():
                continue
            with (
                atomic_path(path) as temporary,
                temporary.open("wb") as file,
                webdataset.TarWriter(file, encoder=False, mtime=0) as tar,
            ):
                for key, questions, scene in shard:
                    assert scene.video is not None
                    tar.write({"__key__": key, "json": questions, "mp4": scene.video.read_bytes()})


def _sample(scene: ExportedScene) -> Sample:
    first = scene.records[0]
    key = f"video_{first.scene_index:05d}"
    rows = [record.row() | {"video": f"{key}.mp4"} for record in scene.records]
    document = {"scene_index": first.scene_index, "split": first.split, "seed": first.seed, "questions": rows}
    return key, json.dumps(document).encode(), scene


def _shards(samples: Iterator[Sample], limit: int) -> Iterator[list[Sample]]:
    """Groups of consecutive samples whose files stay below the limit (bytes), unless a single one is larger."""
    shard: list[Sample] = []
    size = 0
    for sample in samples:
        _, questions, scene = sample
        assert scene.video is not None
        added = len(questions) + scene.video.stat().st_size + 2 * MEMBER_BYTES
        if shard and size + added > limit:
            yield shard
            shard, size = [], 0
        shard.append(sample)
        size += added
    if shard:
        yield shard


WEBDATASET = Exporter(_write, needs="webdataset", videos=("copy",))
"""SPLIT-NUMBER.tar with KEY.mp4 and KEY.json of each video: `scene_index`, `split`, `seed`, and the records as `questions`."""
