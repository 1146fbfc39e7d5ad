"""Inputs of the collision network: the motion of objects, and of pairs that come near each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from nsdr.dynamics.motion_states import MotionStates, object_features
from nsdr.tracking.localization import expected_size
from nsdr.tracking.visibility import hidden_sides
from nsdr.types import SceneObject
from nsdr.world.vocabulary import Vocabulary
from nsdr.world.world import Scales

NEAR_WORLD = 0.6
"""Pairs whose surfaces never come closer than this do not collide (world units in CLEVRER). In all 4,223 collisions of the
left-out scenes of `train`, they come closer (`python -m benchmarks.collisions` counts collisions in which they do not)."""
SPEED_WORLD = 0.05
"""Unit of displacements in one frame (world units in CLEVRER)."""
BENDS = ((3, 0.1), (8, 0.2))
"""Reach (frames) and unit (world units in CLEVRER) of the second differences, which show changes of velocity."""
GAPS_WORLD, MIN_GAP = (0.1, 0.5), -3.0
"""Units of the gap between two objects (world units in CLEVRER), and lower limit of the first."""
POSITION_WORLD = 3.0
"""Unit of positions (world units in CLEVRER)."""
BOX_PX = 20.0
"""Unit of gaps between boxes (pixels of CLEVRER's images)."""
MAX_INPUT = 5.0
"""Limit to which inputs are clamped."""
MOTION_CHANNELS, PAIR_CHANNELS = 17, 22
"""Numbers of input channels of an object beside its `feature_count`, and of a pair."""


@dataclass(frozen=True)
class MotionArrays:
    """The tracks of n objects in F frames, from which the inputs of the network are computed.

    Attributes:
        location_world: (n, F, 2) positions (world units), as in `MotionStates`.
        detected, reliable, present: (n, F) bool, as in `MotionStates`.
        hidden: (n, F, 4) bool, whether each side (left, top, right, bottom) of a detected box is hidden.
        box_px: (n, F, 4) centre (column, row), width and height of the box (pixels).
        size: (n, F, 2) logarithms of the width and height of the box, relative to those expected at its position.
        static: (n, `feature_count`) one-hot shape and material.
        radius: (n,) the mean of half the widths of the object (world units).
    """

    location_world: NDArray[Any]
    detected: NDArray[Any]
    reliable: NDArray[Any]
    present: NDArray[Any]
    hidden: NDArray[Any]
    box_px: NDArray[Any]
    size: NDArray[Any]
    static: NDArray[Any]
    radius: NDArray[Any]


class NetworkInputs(NamedTuple):
    """Inputs of the network for the O objects and P pairs of one or several videos.

    Attributes:
        objects: (O, `MOTION_CHANNELS` + `feature_count`, F) inputs of objects.
        pairs: (2 P, `PAIR_CHANNELS`, F) inputs of pairs: P rows from the first object to the second, then P in the other
            direction.
        edges: (2 P, 2) int, indices of the two objects of each row of `pairs`.
    """

    objects: Tensor
    pairs: Tensor
    edges: Tensor


def arrays_from_states(states: MotionStates) -> MotionArrays:
    """Make the (n, F, ...) arrays of a video from its motion states."""
    box, location = states.box_px, states.location_world
    corners = np.where(states.detected[..., None], states.box_xyxy_px, np.nan)
    hidden = hidden_sides(corners.transpose(1, 0, 2), states.camera).transpose(1, 0, 2)
    expected, vocabulary = np.ones_like(location), states.world.vocabulary
    for i, o in enumerate(states.objects):
        expected[i] = expected_size(vocabulary.shape(o.shape), location[i], states.camera)
    with np.errstate(invalid="ignore"):
        size = np.nan_to_num(np.log(np.maximum(box[..., 2:], 1.0) / np.maximum(expected, 1.0)))
    static, radius = object_features(states.objects, vocabulary), radii(states.objects, vocabulary)
    flags = states.detected, states.reliable, states.present
    return MotionArrays(location, *flags, hidden & states.detected[..., None], box, size, static, radius)


def radii(objects: Sequence[SceneObject], vocabulary: Vocabulary) -> NDArray[Any]:
    """(n,) the mean of half the widths of each object (world units)."""
    return np.array([vocabulary.shape(o.shape).radius_world for o in objects])


def near_pairs(location_world: NDArray[Any], radius: NDArray[Any], scales: Scales) -> NDArray[Any]:
    """The pairs (P, 2) int, i < j, of objects at positions (n, F, 2) that come near each other.

    Args:
        location_world: (n, F, 2) positions (world units).
        radius: (n,) see `MotionArrays`.
        scales: of the world.
    """
    n = len(location_world)
    if n < 2:
        return np.zeros((0, 2), int)
    apart = np.linalg.norm(location_world[:, None] - location_world[None], axis=-1).min(-1)
    near = radius[:, None] + radius + NEAR_WORLD * max(scales.size, scales.frame)
    return np.argwhere(np.triu(apart < near, 1))


def network_inputs(arrays: MotionArrays, pairs: NDArray[Any], scales: Scales) -> NetworkInputs:
    """Make the inputs for pairs (P, 2) of one video, or of several videos whose objects are concatenated.

    Lengths are relative to the `scales` of the world.
    """
    position = torch.from_numpy(np.ascontiguousarray(arrays.location_world, np.float32)).transpose(1, 2)
    frames = position.shape[-1]
    padded = _continued(position, max(k for k, _ in BENDS))
    velocity = _difference(padded, frames, scales)
    bends = [_bend(padded, frames, k) / (unit * scales.frame) for k, unit in BENDS]
    flags = [arrays.detected[..., None], arrays.reliable[..., None], arrays.present[..., None], arrays.hidden]
    seen = np.concatenate([*flags, arrays.size], -1).astype(np.float32)
    static = torch.from_numpy(arrays.static.astype(np.float32))[:, :, None].expand(-1, -1, frames)
    parts = [
        velocity,
        *bends,
        torch.from_numpy(seen).transpose(1, 2),
        position / (POSITION_WORLD * scales.size),
        static,
    ]
    objects = torch.cat(parts, 1).clamp(-MAX_INPUT, MAX_INPUT)
    edges = torch.from_numpy(np.concatenate([pairs, pairs[:, ::-1]]).astype(np.int64))
    box = torch.from_numpy(arrays.box_px.astype(np.float32)).transpose(1, 2)
    radius = torch.from_numpy(arrays.radius.astype(np.float32))
    return NetworkInputs(objects, _pair_inputs(padded, velocity, bends, box, edges, radius, scales), edges)


def _pair_inputs(
    padded: Tensor, velocity: Tensor, bends: list[Tensor], box: Tensor, edges: Tensor, radius: Tensor, scales: Scales
) -> Tensor:
    """Inputs of pairs (E, `PAIR_CHANNELS`, F): relative motion; velocities and their changes along and across their line."""
    i, j = edges[:, 0], edges[:, 1]
    frames = velocity.shape[-1]
    margin = (padded.shape[-1] - frames) // 2
    apart_padded = padded[j] - padded[i]
    distance_padded = apart_padded.norm(dim=1, keepdim=True)
    apart, distance = (x[..., margin : margin + frames] for x in (apart_padded, distance_padded))
    touching = (radius[i] + radius[j])[:, None, None]
    along = apart / distance.clamp(min=touching / 2)
    across = torch.stack([-along[:, 1], along[:, 0]], 1)
    gap, (small, large) = distance - touching, (unit * scales.size for unit in GAPS_WORLD)
    approach = _difference(distance_padded, frames, scales)
    parts = [apart / scales.size, (gap / small).clamp(MIN_GAP, MAX_INPUT), gap / large, approach]
    parts += [_bend(distance_padded, frames, k) / (unit * scales.frame) for k, unit in BENDS]
    for change in (velocity, *bends):
        for of in (change[i], change[j]):
            parts += [(of * along).sum(1, keepdim=True), (of * across).sum(1, keepdim=True)]
    difference, reach = (box[j] - box[i])[:, :2], (box[j] + box[i])[:, 2:] / 2
    lower = difference[:, 1:] + (box[j] - box[i])[:, 3:] / 2
    parts += [(difference.abs() - reach) / (BOX_PX * scales.px), lower / (BOX_PX * scales.px)]
    return torch.cat(parts, 1).clamp(-MAX_INPUT, MAX_INPUT)


def _continued(x: Tensor, frames: int) -> Tensor:
    """Extend x (..., F) by `frames` at both ends by point reflection: (..., F + 2 frames)."""
    index = torch.arange(-frames, x.shape[-1] + frames)
    last = x.shape[-1] - 1
    inside = index.clamp(0, last)
    reflected = (2 * inside - index).clamp(0, last)
    return torch.where(index == inside, x[..., inside], 2 * x[..., inside] - x[..., reflected])


def _difference(padded: Tensor, frames: int, scales: Scales) -> Tensor:
    """Central differences (..., frames) of an extended x (units of `SPEED_WORLD` per frame)."""
    margin = (padded.shape[-1] - frames) // 2
    ahead, behind = padded[..., margin + 1 : margin + 1 + frames], padded[..., margin - 1 : margin - 1 + frames]
    return (ahead - behind) / (2 * SPEED_WORLD * scales.frame)


def _bend(padded: Tensor, frames: int, reach: int) -> Tensor:
    """Second differences (..., frames) of an extended x: x(t + reach) + x(t - reach) - 2 x(t)."""
    margin = (padded.shape[-1] - frames) // 2
    ahead, behind = padded[..., margin + reach :][..., :frames], padded[..., margin - reach :][..., :frames]
    return ahead + behind - 2 * padded[..., margin : margin + frames]
