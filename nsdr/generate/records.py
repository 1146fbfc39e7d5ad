"""A simulated scene as CLEVRER's files: annotation, mask proposals, and the truth that the release withholds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as rle

from nsdr.generate.physics.bullet import Contact
from nsdr.generate.physics.scene import SimulatedScene
from nsdr.generate.render.raycast import Solid, instance_ids
from nsdr.tracking.visibility import in_image
from nsdr.world.camera import Camera
from nsdr.world.shapes import rendered_rotation

__all__ = ["annotation_document", "frame_masks", "proposal_document", "solids_at", "truth_document", "visible_frames"]

MIN_VISIBLE_PX = 20
"""Objects with fewer visible pixels get no mask."""


def solids_at(scene: SimulatedScene, frame: int) -> list[Solid]:
    """The objects as they stand in a frame."""
    motion = scene.motion
    return [
        Solid(
            o.shape,
            motion.location_world[o.id, frame],
            rendered_rotation(o.shape, motion.orientation[o.id, frame]).as_matrix(),
        )
        for o in scene.objects
    ]


def visible_frames(scene: SimulatedScene, camera: Camera) -> NDArray[np.bool_]:
    """(n, F) bool: in the image of a camera."""
    motion = scene.motion
    return np.stack(
        [in_image(o.shape, motion.location_world[o.id], motion.orientation[o.id, :, 2], camera) for o in scene.objects]
    )


def frame_masks(scene: SimulatedScene, frame: int, camera: Camera) -> dict[int, str]:
    """COCO run-length strings of the visible masks, by object id."""
    ids = instance_ids(solids_at(scene, frame), camera)
    masks = {}
    for o in scene.objects:
        mask = ids == o.id
        if mask.sum() >= MIN_VISIBLE_PX:
            masks[o.id] = rle.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode()
    return masks


def annotation_document(scene: SimulatedScene, index: int, filename: str, camera: Camera) -> dict[str, Any]:
    """The content of `annotation_N.json`: objects, motion and collisions of the video's frames."""
    return {
        "scene_index": index,
        "video_filename": filename,
        "object_property": [{"object_id": o.id, **_words(scene, o.id)} for o in scene.objects],
        "motion_trajectory": _frames(scene, scene.n_frames, camera),
        "collision": [_collision(c) for c in scene.motion.contacts if c.frame < scene.n_frames],
    }


def proposal_document(
    scene: SimulatedScene, index: int, filename: str, camera: Camera, masks: Sequence[dict[int, str]]
) -> dict[str, Any]:
    """The content of `proposal_N.json`: exact masks with a score of 1. `masks`: as `frame_masks`, for each frame."""
    frames = []
    for f, row in enumerate(masks):
        objects = []
        for i, counts in row.items():
            mask = {"size": [camera.height, camera.width], "counts": counts}
            objects.append({"mask": mask, **_words(scene, i), "score": 1.0, "video_index": index, "frame_index": f})
        frames.append({"frame_index": f, "objects": objects})
    return {"video_index": index, "video_filename": filename, "frames": frames}


def truth_document(scene: SimulatedScene, index: int, camera: Camera) -> dict[str, Any]:
    """All simulated frames, all collisions, and for each object the collisions without it (`scene_from_truth` reads it)."""
    mass = [round(float(m), 4) for m in scene.mass]
    return {
        "scene_index": index,
        "seed": scene.seed,
        "n_frames": scene.n_frames,
        "objects": [{"object_id": o.id, "mass": mass[o.id], **_words(scene, o.id)} for o in scene.objects],
        "frames": _frames(scene, scene.motion.location_world.shape[1], camera),
        "collisions": [_collision(c) for c in scene.motion.contacts],
        "counterfactual": {str(i): [_collision(c) for c in contacts] for i, contacts in scene.counterfactual.items()},
    }


def _words(scene: SimulatedScene, i: int) -> dict[str, str]:
    o = scene.objects[i]
    return {"color": o.color, "material": o.material, "shape": o.shape}


def _collision(contact: Contact) -> dict[str, Any]:
    return {
        "object_ids": list(contact.bodies),
        "frame_id": contact.frame,
        "location": [round(float(x), 4) for x in contact.location_world],
    }


def _frames(scene: SimulatedScene, n_frames: int, camera: Camera) -> list[dict[str, Any]]:
    visible = visible_frames(scene, camera)
    motion = scene.motion
    vectors = {
        "location": motion.location_world.round(4),
        "orientation": motion.orientation.round(4),
        "velocity": motion.velocity.round(4),
        "angular_velocity": motion.angular_velocity.round(4),
    }
    return [
        {
            "frame_id": f,
            "objects": [
                {"object_id": o.id, **{name: v[o.id, f].tolist() for name, v in vectors.items()}}
                | {"inside_camera_view": bool(visible[o.id, f])}
                for o in scene.objects
            ],
        }
        for f in range(n_frames)
    ]
