"""Annotations as tracks: what a perfect frame parser and tracker would have seen."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nsdr.types import SceneObject, Track, VideoTracks
from nsdr.world.camera import CLEVRER_CAMERA, HEIGHT_PX, WIDTH_PX
from nsdr.world.shapes import surface_points

__all__ = ["tracks_from_annotation", "tracks_from_motion"]


def tracks_from_annotation(annotation: Mapping[str, Any]) -> VideoTracks:
    """True positions of all objects while they are in view, with the boxes of their outlines; score 1.

    Args:
        annotation: checked content of an annotation file. Objects that are never in view are left out.
    """
    return tracks_from_motion(annotation["object_property"], annotation["motion_trajectory"])


def tracks_from_motion(objects: Sequence[Mapping[str, Any]], frames: Sequence[Mapping[str, Any]]) -> VideoTracks:
    """The same from an annotation's, or a truth file's, lists of objects and frames."""
    view, image = CLEVRER_CAMERA, np.array([WIDTH_PX, HEIGHT_PX])
    tracks: list[Track] = []
    for properties in sorted(objects, key=lambda p: int(p["object_id"])):
        words = (properties["color"], properties["material"], properties["shape"])
        seen, positions, boxes = [], [], []
        for f, frame in enumerate(frames):
            row = next((o for o in frame["objects"] if o["object_id"] == properties["object_id"]), None)
            if row is None or not row["inside_camera_view"]:
                continue
            outline = view.pixels(surface_points(words[2], row["orientation"][2]) + np.array(row["location"]))
            low, high = np.clip(np.floor(outline.min(0)), 0, image), np.clip(np.ceil(outline.max(0)), 0, image)
            if np.isfinite(outline).all() and (high > low).all():
                seen.append(f)
                positions.append(row["location"][:2])
                boxes.append([*low, *high])
        if seen:
            box = np.array(boxes, int)
            middle = (box[:, :2] + box[:, 2:]) / 2
            track = SceneObject(len(tracks), *words), np.array(seen), np.array(positions, float), middle, box
            tracks.append(Track(*track, np.ones(len(seen))))
    return VideoTracks(len(frames), tuple(tracks))
