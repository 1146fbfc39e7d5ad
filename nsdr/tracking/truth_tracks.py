"""Tracks from annotations: what a perfect frame parser and tracker would return."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nsdr.types import SceneObject, Track, VideoTracks
from nsdr.world.camera import CLEVRER_CAMERA, HEIGHT_PX, WIDTH_PX, Camera
from nsdr.world.shapes import surface_points

__all__ = ["tracks_from_annotation", "tracks_from_motion"]


def tracks_from_annotation(annotation: Mapping[str, Any]) -> VideoTracks:
    """True positions of all objects in the frames where they are in view, with the boxes of their outlines and score 1.

    Objects that are never in view are left out.

    Args:
        annotation: validated content of an annotation file.
    """
    return tracks_from_motion(annotation["object_property"], annotation["motion_trajectory"])


def tracks_from_motion(
    objects: Sequence[Mapping[str, Any]], frames: Sequence[Mapping[str, Any]], camera: Camera = CLEVRER_CAMERA
) -> VideoTracks:
    """Tracks as of `tracks_from_annotation`, from the lists of objects and frames of an annotation or a truth file.

    Args:
        objects: `object_id`, `color`, `material` and `shape` of each object.
        frames: for each frame, `objects` with `object_id`, `inside_camera_view`, `location` (x, y, z in world units) and
            `orientation` (radians).
        camera: that took the video.
    """
    size = np.array([WIDTH_PX, HEIGHT_PX])
    tracks: list[Track] = []
    for properties in sorted(objects, key=lambda p: int(p["object_id"])):
        words = (properties["color"], properties["material"], properties["shape"])
        seen, positions, boxes = [], [], []
        for f, frame in enumerate(frames):
            row = next((o for o in frame["objects"] if o["object_id"] == properties["object_id"]), None)
            if row is None or not row["inside_camera_view"]:
                continue
            outline = camera.pixels(surface_points(words[2], row["orientation"][2]) + np.array(row["location"]))
            low, high = np.clip(np.floor(outline.min(0)), 0, size), np.clip(np.ceil(outline.max(0)), 0, size)
            if np.isfinite(outline).all() and (high > low).all():
                seen.append(f)
                positions.append(row["location"][:2])
                boxes.append([*low, *high])
        if seen:
            box = np.array(boxes, int)
            centre = (box[:, :2] + box[:, 2:]) / 2
            scene_object = SceneObject(len(tracks), *words)
            location = np.array(positions, float)
            tracks.append(Track(scene_object, np.array(seen), location, centre, box, np.ones(len(seen))))
    return VideoTracks(len(frames), tuple(tracks), camera)
