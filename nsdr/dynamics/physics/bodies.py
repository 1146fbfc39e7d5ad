"""What the planar simulator knows of a body: its outline seen from above, its inertia, and how it slides and rebounds."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.physics.bullet_rules import CONTACT_THRESHOLD, HULL_MARGIN_WORLD
from nsdr.dynamics.sliding import LAW, sliding_law
from nsdr.types import SceneObject
from nsdr.validation import FloatArray
from nsdr.world.physics import Physics
from nsdr.world.shapes import CUBE_EDGE_WORLD, CUBE_EXPONENT, CUBE_STEPS
from nsdr.world.vocabulary import CLEVRER, Material, Shape
from nsdr.world.world import Scales, World

OUTLINE_POINTS = 4 * (CUBE_STEPS + 1)
"""Number of points on the outline of a box."""
GIVEN_GAP_WORLD = 0.003
"""Gap at which bodies with a given rebound make contact: the mean gap under Bullet's rule at usual speeds (world units in
CLEVRER)."""
STEP_REACH_WORLD = 0.03
"""Distance that two fast bodies cover in a Bullet step (world units in CLEVRER, rounded up)."""
MIN_APPROACH_WORLD_PER_S = 0.02
"""The time of a contact at a slower approach is not differentiated, because its derivatives would be too large (world units/s
in CLEVRER)."""

BODY = np.dtype(
    [
        ("is_box", bool),  # only boxes spin
        ("is_sphere", bool),  # only spheres have no upright wall
        ("half", float, (2,)),  # half of the extent along x and y (world units)
        ("flat", float, (2,)),  # half of the flat part of the sides of a box
        ("round", float),  # the largest circle inside the outline, with Bullet's margin
        ("corner", float),  # by how much corners extend beyond it, rounded up
        ("height", float),
        ("outline", float, (OUTLINE_POINTS, 2)),  # points on the outline of a box, corner by corner
        ("inertia", float),  # moment of inertia per mass (world units²), of the bounding box as in Bullet
        (
            "lever",
            float,
        ),  # half of the mean width, with which spin adds to the speed over the ground in the test for rest
        ("restitution", float),
        ("threshold", float),  # gap below which Bullet handles a contact (world units)
        ("angular_damping", float),
        ("spinning", float),  # torque per mass with which the ground resists spinning (world units²/s²)
        ("step_seconds", float),  # of Bullet
        ("steps_per_frame", int),
        ("given_gap", float),  # `GIVEN_GAP_WORLD`, `STEP_REACH_WORLD` and `MIN_APPROACH_WORLD_PER_S` of the world
        ("step_reach", float),
        ("min_approach", float),
        ("law", LAW),  # how it slides
    ],
    align=True,
)
"""A body and the physics of its world, as compiled functions read them."""

_INDEX = np.arange(OUTLINE_POINTS).reshape(4, -1)
CYCLE = np.concatenate([_INDEX[0], _INDEX[2, ::-1], _INDEX[3], _INDEX[1, ::-1]])
"""(28,) indices of the points of an outline in the order of their angles."""


def body_records(objects: Sequence[SceneObject], world: World) -> NDArray[np.void]:
    """(n,) records of `BODY` of the objects of a scene."""
    words, scales, found = world.vocabulary, world.scales, np.zeros(len(objects), BODY)
    for i, o in enumerate(objects):
        found[i] = _body(words.shape(o.shape), words.material(o.material), world.physics, scales)
    return found


@lru_cache(maxsize=256)
def _body(shape: Shape, material: Material, physics: Physics, scales: Scales) -> np.void:
    half = np.array(shape.size_world) / 2
    extent = half + HULL_MARGIN_WORLD
    edge = edge_world(shape)
    body = np.zeros(1, BODY)[0]
    body["is_box"], body["is_sphere"] = shape.solid == "box", shape.solid == "sphere"
    body["half"], body["flat"], body["height"] = half[:2], half[:2] - edge, shape.size_world[2]
    body["round"] = min(extent[:2])
    if shape.solid == "box":
        body["outline"], body["corner"] = outline_of(shape), corner_world(shape)
    body["inertia"] = float(((2 * extent[:2]) ** 2).sum() / 12)
    body["lever"], body["restitution"] = shape.radius_world, material.restitution
    body["threshold"] = CONTACT_THRESHOLD * round(float(np.linalg.norm(extent)), 3)
    body["angular_damping"], body["spinning"] = physics.angular_damping, physics.spinning_friction * physics.gravity
    body["step_seconds"], body["steps_per_frame"] = physics.step_seconds, physics.steps_per_frame
    body["given_gap"], body["step_reach"] = GIVEN_GAP_WORLD * scales.step, STEP_REACH_WORLD * scales.step
    body["min_approach"] = MIN_APPROACH_WORLD_PER_S * scales.speed
    body["law"] = sliding_law(shape, material, physics, scales)
    return body


@lru_cache(maxsize=256)
def corner_world(shape: Shape) -> float:
    """By how much the corners of a box extend beyond the largest circle inside it, rounded up; 0 for others (world units)."""
    if shape.solid != "box":
        return 0.0
    return math.ceil(100 * (np.hypot(*outline_of(shape).T).max() - min(shape.size_world[:2]) / 2)) / 100


def edge_world(shape: Shape) -> float:
    """Width of the rounded edge of a box, as of its hull (world units)."""
    return CUBE_EDGE_WORLD * (min(shape.size_world) / min(CLEVRER.shapes[0].size_world))


def outline_of(shape: Shape) -> FloatArray:
    """(28, 2) points on the outline of a box seen from above, corner by corner (world units)."""
    angles, edge = np.pi / 2 * np.arange(CUBE_STEPS + 1) / CUBE_STEPS, edge_world(shape)
    circle = np.abs(np.stack([np.cos(angles), np.sin(angles)], 1)) ** (2 / CUBE_EXPONENT)
    arc = np.array(shape.size_world[:2]) / 2 - edge + edge * circle
    return np.concatenate([arc * s for s in ((1, 1), (1, -1), (-1, 1), (-1, -1))])
