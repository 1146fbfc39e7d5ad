"""Annotations of frames in files: `annotations_*.jsonl`."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec

from nsdr.clevrer.files.masks import check_mask
from nsdr.clevrer.files.schema import check_lines
from nsdr.io.limits import check_limit
from nsdr.io.reading import parse_json_lines, read_bytes
from nsdr.validation import Count, PositiveCount, convert, expect
from nsdr.world.vocabulary import Word


class _Segmentation(msgspec.Struct):
    size: tuple[PositiveCount, PositiveCount]
    counts: str


class _Object(msgspec.Struct):
    color: Word
    material: Word
    shape: Word
    segmentation: _Segmentation


class _Record(msgspec.Struct):
    file_name: str
    scene: Count
    objects: list[_Object]

    def __post_init__(self) -> None:
        check_lines("", file_name=self.file_name)
        path = PurePosixPath(self.file_name)
        expect(not path.is_absolute() and ".." not in path.parts, "file_name", "a file below images/", self.file_name)
        check_limit(len(self.objects), "frame_objects", "objects")
        for i, o in enumerate(self.objects):
            mask, place = o.segmentation, f"objects[{i}].segmentation"
            same = mask.size == self.objects[0].segmentation.size
            expect(same, f"{place}.size", "that of the first object", list(mask.size))
            check_limit(mask.size[0] * mask.size[1], "image_pixels", f"{place}.size")
            check_mask(list(mask.size), mask.counts, *mask.size, place)


def read_frame_records(folder: Path, words: Mapping[str, Sequence[str]]) -> Iterator[dict[str, Any]]:
    """Yield `{file_name, scene, objects: [{color, material, shape, segmentation (compressed COCO RLE)}]}` of every frame.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    for path in sorted(folder.glob("annotations_*.jsonl")):
        for number, record in parse_json_lines(read_bytes(path, kind="JSON Lines file"), str(path)):
            convert(record, _Record, f"{path}, line {number}: ")
            for i, o in enumerate(record["objects"]):
                for name, known in words.items():
                    place = f"{path}, line {number}: objects[{i}].{name}"
                    expect(o[name] in known, place, f"one of {', '.join(known)}", repr(o[name]))
            yield record
