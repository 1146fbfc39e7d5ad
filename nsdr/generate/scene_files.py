"""A simulated scene in CLEVRER's file formats: annotation, mask proposals, and the ground truth that the release withholds."""

from typing import Any

import numpy as np
from pycocotools import mask as rle

from nsdr.generate.physics.bullet import Contact
from nsdr.generate.physics.scene import SimulatedScene
from nsdr.generate.render.geometry import Solid, instance_ids
from nsdr.io.worlds import stored_world
from nsdr.tracking.visibility import in_image
from nsdr.world.camera import Camera
from nsdr.world.shapes import rendered_rotation
from nsdr.world.vocabulary import Shape

MIN_VISIBLE_PX = 20
"""Objects with fewer visible pixels get no mask."""
DECIMALS = 4
"""Decimals of the numbers in the files."""


def solids_at(scene: SimulatedScene, frame: int) -> list[Solid]:
    """Geometry of all objects in a frame."""
    motion, shapes = scene.motion, _shapes(scene)
    return [
        Solid(
            shape,
            motion.location_world[i, frame],
            rendered_rotation(shape, motion.orientation[i, frame]).as_matrix(),
        )
        for i, shape in enumerate(shapes)
    ]


def _shapes(scene: SimulatedScene) -> list[Shape]:
    return [scene.world.vocabulary.shape(o.shape) for o in scene.objects]


def _masks(scene: SimulatedScene, frame: int, camera: Camera) -> dict[int, str]:
    """Masks of the visible parts as COCO run-length strings, by object id; objects with few pixels are left out."""
    ids = instance_ids(solids_at(scene, frame), camera)
    masks = {}
    for o in scene.objects:
        mask = ids == o.id
        if mask.sum() >= MIN_VISIBLE_PX:
            masks[o.id] = rle.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"].decode()
    return masks


def annotation_document(scene: SimulatedScene, index: int, filename: str, camera: Camera) -> dict[str, Any]:
    """Content of `annotation_N.json`: objects, motion and collisions within the video."""
    return {
        "scene_index": index,
        "video_filename": filename,
        "object_property": [{"object_id": o.id, **_attributes(scene, o.id)} for o in scene.objects],
        "motion_trajectory": _frames(scene, scene.n_frames, camera),
        "collision": [_collision(c) for c in scene.motion.contacts if c.frame < scene.n_frames],
    } | stored_world(scene.world)


def proposal_document(scene: SimulatedScene, index: int, filename: str, camera: Camera) -> dict[str, Any]:
    """Content of `proposal_N.json`: exact masks with score 1."""
    frames = []
    for f in range(scene.n_frames):
        objects = []
        for i, counts in _masks(scene, f, camera).items():
            mask = {"size": [camera.height, camera.width], "counts": counts}
            objects.append(
                {"mask": mask, **_attributes(scene, i), "score": 1.0, "video_index": index, "frame_index": f}
            )
        frames.append({"frame_index": f, "objects": objects})
    content = {"video_index": index, "video_filename": filename, "frames": frames}
    return content | stored_world(scene.world)


def truth_document(scene: SimulatedScene, index: int, camera: Camera) -> dict[str, Any]:
    """Content of `truth_N.json`: all simulated frames, all collisions, and the collisions without each object.

    `nsdr.clevrer.files.scenes.scene_from_truth` reads it.
    """
    mass = [round(float(m), DECIMALS) for m in scene.mass]
    return {
        "scene_index": index,
        "seed": scene.seed,
        "n_frames": scene.n_frames,
        "objects": [{"object_id": o.id, "mass": mass[o.id], **_attributes(scene, o.id)} for o in scene.objects],
        "frames": _frames(scene, scene.motion.location_world.shape[1], camera),
        "collisions": [_collision(c) for c in scene.motion.contacts],
        "counterfactual": {str(i): [_collision(c) for c in contacts] for i, contacts in scene.counterfactual.items()},
    } | stored_world(scene.world)


def _attributes(scene: SimulatedScene, i: int) -> dict[str, str]:
    o = scene.objects[i]
    return {"color": o.color, "material": o.material, "shape": o.shape}


def _collision(contact: Contact) -> dict[str, Any]:
    return {
        "object_ids": list(contact.bodies),
        "frame_id": contact.frame,
        "location": [round(float(x), DECIMALS) for x in contact.location_world],
    }


def _frames(scene: SimulatedScene, n_frames: int, camera: Camera) -> list[dict[str, Any]]:
    motion = scene.motion
    visible = [
        in_image(shape, motion.location_world[i], motion.orientation[i, :, 2], camera)
        for i, shape in enumerate(_shapes(scene))
    ]
    vectors = {
        "location": motion.location_world.round(DECIMALS),
        "orientation": motion.orientation.round(DECIMALS),
        "velocity": motion.velocity.round(DECIMALS),
        "angular_velocity": motion.angular_velocity.round(DECIMALS),
    }
    return [
        {
            "frame_id": f,
            "objects": [
                {"object_id": o.id, **{name: v[o.id, f].tolist() for name, v in vectors.items()}}
                | {"inside_camera_view": bool(visible[o.id][f])}
                for o in scene.objects
            ],
        }
        for f in range(n_frames)
    ]
