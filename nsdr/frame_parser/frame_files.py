"""Annotations of frames in files: `annotations_*.jsonl`, or COCO's JSON."""

from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

from pycocotools import mask as rle

from nsdr.clevrer.files.masks import check_mask
from nsdr.clevrer.files.schema import check_new, get, get_number, get_text, get_whole, scene_object, shown
from nsdr.errors import DataError
from nsdr.io.limits import check_limit
from nsdr.io.reading import parse_json_lines, read_bytes, read_json
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["read_frame_records"]

MIN_POLYGON_NUMBERS = 6
"""Coordinates of a polygon with three corners."""


def read_frame_records(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield `{file_name, scene, objects: [{color, material, shape, segmentation (compressed COCO RLE)}]}` of every frame.

    Raises:
        DataError: names the file, the location in the file and what was expected there.
    """
    lines = sorted(folder.glob("annotations_*.jsonl"))
    for path in lines:
        for number, record in parse_json_lines(read_bytes(path, kind="JSON Lines file"), str(path)):
            where = f"{path}, line {number}"
            check_record(record, where)
            yield record
    if not lines:
        for path in sorted(folder.glob("*.json")):
            yield from _coco_records(path)


def check_record(record: Any, where: str) -> None:
    """Check a line of `annotations_*.jsonl`; raises `DataError`."""
    _check_file_name(record, where)
    get_whole(record, "scene", where, 0, float("inf"))
    objects = get(record, "objects", list, where)
    check_limit(len(objects), "frame_objects", f"{where}: objects")
    for i, o in enumerate(objects):
        place = f"{where}: objects[{i}]"
        scene_object(o, 0, place)
        segmentation = get(o, "segmentation", dict, place)
        size = get(segmentation, "size", list, f"{place}.segmentation")
        if size != objects[0]["segmentation"]["size"]:
            raise DataError(f"{place}.segmentation.size: {shown(size)}, that of the first object is another")
        _check_compressed(segmentation, *_height_width(size, f"{place}.segmentation.size"), f"{place}.segmentation")


def _check_file_name(record: Any, where: str) -> None:
    name = PurePosixPath(get_text(record, "file_name", where))
    if name.is_absolute() or ".." in name.parts:
        raise DataError(f"{where}.file_name: expected a file below images/, got {shown(str(name))}")


def _height_width(size: list[Any], where: str) -> tuple[int, int]:
    if len(size) != 2 or any(type(n) is not int or n < 1 for n in size):
        raise DataError(f"{where}: expected height and width, got {shown(size)}")
    check_limit(size[0] * size[1], "image_pixels", where)
    return size[0], size[1]


def _check_compressed(segmentation: dict[str, Any], height: int, width: int, where: str) -> None:
    check_mask(segmentation.get("size"), segmentation.get("counts"), height, width, where)


def _coco_records(path: Path) -> Iterator[dict[str, Any]]:
    """Frame records of a COCO file; an image's `scene` is its `video_id` if it has one, else its own `id`."""
    content = read_json(path)
    words: dict[int, dict[str, str]] = {}
    images: dict[int, tuple[dict[str, Any], tuple[int, int]]] = {}
    for i, row in enumerate(get(content, "categories", list, str(path))):
        where = f"{path}: categories[{i}]"
        number, name = get_whole(row, "id", where, 0, float("inf")), get_text(row, "name", where).split()
        check_new(number, words, f"{where}.id")
        if len(name) != len(ATTRIBUTES) or any(
            w not in known for w, known in zip(name, ATTRIBUTES.values(), strict=True)
        ):
            found = " ".join(name)
            raise DataError(f'{path}: category {number}: expected a name like "red metal cube", got {shown(found)}')
        words[number] = dict(zip(ATTRIBUTES, name, strict=True))
    for i, row in enumerate(get(content, "images", list, str(path))):
        where = f"{path}: images[{i}]"
        number = get_whole(row, "id", where, 0, float("inf"))
        check_new(number, images, f"{where}.id")
        _check_file_name(row, where)
        scene = get_whole(row, "video_id" if "video_id" in row else "id", where, 0, float("inf"))
        size = _height_width([get(row, side, int, where) for side in ("height", "width")], where)
        images[number] = ({"file_name": row["file_name"], "scene": scene, "objects": []}, size)
    for i, row in enumerate(get(content, "annotations", list, str(path))):
        where = f"{path}: annotations[{i}]"
        image, category = (get(row, key, int, where) for key in ("image_id", "category_id"))
        if image not in images or category not in words:
            raise DataError(f"{where}: image_id {image} or category_id {category} is not in the file")
        record, (height, width) = images[image]
        segmentation: Any = get(row, "segmentation", (list, dict), where)
        mask = _coco_mask(segmentation, height, width, f"{where}.segmentation")
        record["objects"].append({**words[category], "segmentation": mask})
        check_limit(len(record["objects"]), "frame_objects", f"{path}: image {image}")
    yield from (record for record, _ in images.values())


def _coco_mask(segmentation: Any, height: int, width: int, where: str) -> dict[str, Any]:
    """A compressed run-length mask from any of COCO's three forms."""
    if isinstance(segmentation, list):
        if not segmentation:
            raise DataError(f"{where}: expected at least one polygon, got none")
        for i, polygon in enumerate(segmentation):
            place = f"{where}[{i}]"
            if not isinstance(polygon, list) or len(polygon) < MIN_POLYGON_NUMBERS or len(polygon) % 2:
                raise DataError(f"{place}: expected a list of x and y of 3 or more corners, got {shown(polygon)}")
            for k, value in enumerate(polygon):
                get_number({k: value}, k, place, -1, max(height, width) + 1)  # type: ignore[arg-type]
        return dict(rle.merge(rle.frPyObjects(segmentation, height, width)))
    counts = segmentation.get("counts")
    if not isinstance(counts, list):
        _check_compressed(segmentation, height, width, where)
        return dict(segmentation)
    if any(type(n) is not int or n < 0 for n in counts) or sum(counts) != height * width:
        raise DataError(f"{where}.counts: expected runs of the image's {height}x{width} pixels, got {shown(counts)}")
    if segmentation.get("size") != [height, width]:
        raise DataError(f"{where}.size: expected [{height}, {width}], got {shown(segmentation.get('size'))}")
    return dict(rle.frPyObjects(segmentation, height, width))
