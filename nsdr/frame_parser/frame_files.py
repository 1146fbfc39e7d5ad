"""Annotations of frames in files: `annotations_*.jsonl`, or COCO's JSON."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, NotRequired, TypedDict

from msgspec import Meta
from pycocotools import mask as rle

from nsdr.clevrer.files.masks import check_mask
from nsdr.clevrer.files.schema import check_new
from nsdr.errors import DataError
from nsdr.io.limits import check_limit
from nsdr.io.reading import parse_json_lines, read_bytes, read_json
from nsdr.validation import Count, PositiveCount, convert, expect, one_of
from nsdr.world.vocabulary import ATTRIBUTES, COLORS, MATERIALS, SHAPES

__all__ = ["read_frame_records"]

MIN_POLYGON_NUMBERS = 6
"""Coordinates of a polygon with three corners."""
FileName = Annotated[str, Meta(pattern=r"^(?!/|(.*/)?\.\.(/|$))[^\x00]+$", title="a file below images/")]
_NAME = r"\s+".join(f"({'|'.join(words)})" for words in ATTRIBUTES.values())
CategoryName = Annotated[str, Meta(pattern=rf"^\s*{_NAME}\s*$", title='a name like "red metal cube"')]


class _Mask(TypedDict):
    """A run-length mask: its height and width, and the runs as COCO's text or as numbers."""

    size: Annotated[list[PositiveCount], Meta(min_length=2, max_length=2)]
    counts: str | list[int]


class _Object(TypedDict):
    color: Annotated[str, one_of(COLORS)]
    material: Annotated[str, one_of(MATERIALS)]
    shape: Annotated[str, one_of(SHAPES)]
    segmentation: _Mask


class _Frame(TypedDict):
    file_name: FileName
    scene: Count
    frame: NotRequired[Count]
    objects: list[_Object]


class _CocoCategory(TypedDict):
    id: Count
    name: CategoryName


class _CocoImage(TypedDict):
    id: Count
    video_id: NotRequired[Count]
    file_name: FileName
    height: PositiveCount
    width: PositiveCount


class _CocoAnnotation(TypedDict):
    image_id: int
    category_id: int
    segmentation: Annotated[list[list[float]], Meta(min_length=1, title="at least one polygon")] | _Mask


class _CocoFile(TypedDict):
    categories: list[_CocoCategory]
    images: list[_CocoImage]
    annotations: list[_CocoAnnotation]


def read_frame_records(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield `{file_name, scene, objects: [{color, material, shape, segmentation (compressed COCO RLE)}]}` of every frame.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    lines = sorted(folder.glob("annotations_*.jsonl"))
    for path in lines:
        for number, document in parse_json_lines(read_bytes(path, kind="JSON Lines file"), str(path)):
            where = f"{path}, line {number}: "
            record: dict[str, Any] = convert(document, _Frame, where)
            objects = record["objects"]
            check_limit(len(objects), "frame_objects", f"{where}objects")
            for i, mask in enumerate(o["segmentation"] for o in objects):
                place, (height, width) = f"{where}objects[{i}].segmentation", objects[0]["segmentation"]["size"]
                check_limit(height * width, "image_pixels", f"{place}.size")
                check_mask(mask["size"], mask["counts"], height, width, place)
            yield record
    if not lines:
        for path in sorted(folder.glob("*.json")):
            yield from _coco_records(path)


def _coco_records(path: Path) -> Iterator[dict[str, Any]]:
    """Frame records of a COCO file; an image's `scene` is its `video_id` if it has one, else its own `id`."""
    content = convert(read_json(path), _CocoFile, f"{path}: ")
    words: dict[int, dict[str, str]] = {}
    images: dict[int, tuple[dict[str, Any], tuple[int, int]]] = {}
    for i, row in enumerate(content["categories"]):
        check_new(row["id"], words, f"{path}: categories[{i}].id")
        words[row["id"]] = dict(zip(ATTRIBUTES, row["name"].split(), strict=True))
    for i, row in enumerate(content["images"]):
        check_new(row["id"], images, f"{path}: images[{i}].id")
        check_limit(row["height"] * row["width"], "image_pixels", f"{path}: images[{i}]")
        record = {"file_name": row["file_name"], "scene": row.get("video_id", row["id"]), "objects": []}
        images[row["id"]] = record, (row["height"], row["width"])
    for i, row in enumerate(content["annotations"]):
        where, image, category = f"{path}: annotations[{i}]", row["image_id"], row["category_id"]
        if image not in images or category not in words:
            raise DataError(f"{where}: image_id {image} or category_id {category} is not in the file")
        record, size = images[image]
        mask = _compressed(row["segmentation"], *size, f"{where}.segmentation")
        record["objects"].append({**words[category], "segmentation": mask})
        check_limit(len(record["objects"]), "frame_objects", f"{path}: image {image}")
    yield from (record for record, _ in images.values())


def _compressed(segmentation: Any, height: int, width: int, where: str) -> dict[str, Any]:
    """A compressed run-length mask from any of COCO's three forms."""
    if isinstance(segmentation, list):
        far = max(height, width) + 1
        for i, polygon in enumerate(segmentation):
            is_whole = len(polygon) >= MIN_POLYGON_NUMBERS and len(polygon) % 2 == 0
            expect(is_whole, f"{where}[{i}]", "a list of x and y of 3 or more corners", polygon)
            expect(all(-1 <= n <= far for n in polygon), f"{where}[{i}]", f"numbers from -1 to {far}", polygon)
        return dict(rle.merge(rle.frPyObjects(segmentation, height, width)))
    size, counts = segmentation["size"], segmentation["counts"]
    if isinstance(counts, str):
        check_mask(size, counts, height, width, where)
        return dict(segmentation)
    expect(size == [height, width], f"{where}.size", f"[{height}, {width}]", size)
    is_whole = min(counts, default=0) >= 0 and sum(counts) == height * width
    expect(is_whole, f"{where}.counts", f"runs of the image's {height}x{width} pixels", counts)
    return dict(rle.frPyObjects(segmentation, height, width))
