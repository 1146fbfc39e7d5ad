"""Annotations of frames in files: `annotations_*.jsonl`, or COCO's JSON."""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import msgspec
from msgspec import Meta
from pycocotools import mask as rle

from nsdr.clevrer.files.masks import check_mask
from nsdr.clevrer.files.schema import check_lines, check_unique
from nsdr.errors import DataError
from nsdr.io.limits import check_limit
from nsdr.io.reading import parse_json_lines, read_bytes, read_json
from nsdr.validation import Count, PositiveCount, convert, expect
from nsdr.world.vocabulary import ATTRIBUTES, Color, Material, Shape

__all__ = ["read_frame_records"]

Polygon = Annotated[list[float], Meta(min_length=6, title="a list of x and y of 3 or more corners")]


def read_frame_records(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield `{file_name, scene, objects: [{color, material, shape, segmentation (compressed COCO RLE)}]}` of every frame.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    lines = sorted(folder.glob("annotations_*.jsonl"))
    for path in lines:
        for number, record in parse_json_lines(read_bytes(path, kind="JSON Lines file"), str(path)):
            where = f"{path}, line {number}"
            convert(record, _Record, f"{where}: ")
            yield record
    if not lines:
        for path in sorted(folder.glob("*.json")):
            yield from _coco_records(path)


class _Segmentation(msgspec.Struct):
    size: tuple[PositiveCount, PositiveCount]
    counts: str


class _Object(msgspec.Struct):
    color: Color
    material: Material
    shape: Shape
    segmentation: _Segmentation


class _Record(msgspec.Struct):
    file_name: str
    scene: Count
    objects: list[_Object]

    def __post_init__(self) -> None:
        _check_file_name(self.file_name)
        check_limit(len(self.objects), "frame_objects", ".objects")
        for i, o in enumerate(self.objects):
            mask, place = o.segmentation, f".objects[{i}].segmentation"
            same = mask.size == self.objects[0].segmentation.size
            expect(same, f"{place}.size", "that of the first object", list(mask.size))
            check_limit(mask.size[0] * mask.size[1], "image_pixels", f"{place}.size")
            check_mask(list(mask.size), mask.counts, *mask.size, place)


class _Category(msgspec.Struct):
    id: Count
    name: str

    def __post_init__(self) -> None:
        words = self.name.split()
        fits = len(words) == len(ATTRIBUTES) and all(w in k for w, k in zip(words, ATTRIBUTES.values(), strict=True))
        expect(fits, f" category {self.id}", 'a name like "red metal cube"', self.name)


class _Image(msgspec.Struct):
    id: Count
    file_name: str
    height: PositiveCount
    width: PositiveCount
    video_id: Count | None = None

    def __post_init__(self) -> None:
        _check_file_name(self.file_name)
        check_limit(self.height * self.width, "image_pixels", ".height and width")


class _Runs(msgspec.Struct):
    size: tuple[int, int]
    counts: str | list[int]


class _Annotation(msgspec.Struct):
    image_id: int
    category_id: int
    segmentation: Annotated[list[Polygon], Meta(min_length=1, title="at least one polygon")] | _Runs


class _Coco(msgspec.Struct):
    categories: list[_Category]
    images: list[_Image]
    annotations: list[_Annotation]

    def __post_init__(self) -> None:
        check_unique([row.id for row in self.categories], ".categories", ".id")
        check_unique([row.id for row in self.images], ".images", ".id")


def _check_file_name(name: str) -> None:
    check_lines("", file_name=name)
    path = PurePosixPath(name)
    expect(not path.is_absolute() and ".." not in path.parts, ".file_name", "a file below images/", name)


def _coco_records(path: Path) -> Iterator[dict[str, Any]]:
    """Frame records of a COCO file; an image's `scene` is its `video_id` if it has one, else its own `id`."""
    content: _Coco = read_json(path, _Coco)
    words = {row.id: dict(zip(ATTRIBUTES, row.name.split(), strict=True)) for row in content.categories}
    images = {row.id: row for row in content.images}
    records: dict[int, dict[str, Any]] = {
        row.id: {"file_name": row.file_name, "scene": row.id if row.video_id is None else row.video_id, "objects": []}
        for row in content.images
    }
    for i, row in enumerate(content.annotations):
        where, image, category = f"{path}: annotations[{i}]", row.image_id, row.category_id
        if image not in images or category not in words:
            raise DataError(f"{where}: image_id {image} or category_id {category} is not in the file")
        mask = _coco_mask(row.segmentation, images[image].height, images[image].width, f"{where}.segmentation")
        records[image]["objects"].append({**words[category], "segmentation": mask})
        check_limit(len(records[image]["objects"]), "frame_objects", f"{path}: image {image}")
    yield from records.values()


def _coco_mask(segmentation: _Runs | list[Polygon], height: int, width: int, where: str) -> dict[str, Any]:
    """A compressed run-length mask from any of COCO's three forms."""
    if isinstance(segmentation, list):
        most = max(height, width) + 1
        for i, polygon in enumerate(segmentation):
            expect(len(polygon) % 2 == 0, f"{where}[{i}]", "as many x as y", polygon)
            for value in polygon:
                expect(-1 <= value <= most, f"{where}[{i}]", f"numbers from -1 to {most}", value)
        return dict(rle.merge(rle.frPyObjects(segmentation, height, width)))
    size, counts = list(segmentation.size), segmentation.counts
    if isinstance(counts, str):
        check_mask(size, counts, height, width, where)
        return {"size": size, "counts": counts}
    expect(size == [height, width], f"{where}.size", f"[{height}, {width}]", size)
    fits = min(counts, default=0) >= 0 and sum(counts) == height * width
    expect(fits, f"{where}.counts", f"runs of the image's {height}x{width} pixels", counts)
    return dict(rle.frPyObjects({"size": size, "counts": counts}, height, width))
