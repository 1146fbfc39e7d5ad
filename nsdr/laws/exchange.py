"""Whether two objects change in a collision as masses and restitution allow."""

from collections.abc import Sequence

import numpy as np

from nsdr.laws.breaks import JUMP_FRAMES, Break, kick_noise
from nsdr.laws.stretches import TrackStretch
from nsdr.validation import FloatArray

UNSEEN_NOISE_WORLD_PER_S = 0.3
"""Standard deviation of a change of velocity, in addition to the errors of the fits, if positions between both stretches belong
to neither, or are not reliable for more than `JUMP_FRAMES` frames (world units/s in CLEVRER). Chosen on training seeds of the
world `blocks`."""
MIN_ALONG = 0.6
"""Smallest cosine of the angle between an impulse and the line of centres, which differ because cubes push along the normal of
their sides."""


def collision_evidence(
    mine: Sequence[TrackStretch],
    other: Sequence[TrackStretch],
    frame: float,
    ratios: FloatArray,
    max_restitution: float,
    min_closing: float,
) -> tuple[float, float]:
    """Evidence against a lawful collision in the velocity changes of two objects (nats), and their coefficient of restitution.

    Under the laws, the impulses on both objects are opposite, within acos(`MIN_ALONG`) of the line of centres.
    They are at most those of `max_restitution` and, unless one object is a box, which may start to spin, at least those of a
    perfectly inelastic collision.

    Args:
        mine: stretches of the first object before and after the collision.
        other: stretches of the second object before and after the collision.
        frame: frame of the collision.
        ratios: (R,) ratios of the masses of the two objects.
        max_restitution: largest restitution that the collision may show.
        min_closing: lower limit of the approach speed by which the separation speed is divided (world units/s).
    """
    at = np.array([frame])
    p, q = mine[0].position_at(at)[0], other[0].position_at(at)[0]
    (before, after), (other_before, other_after) = ([s.velocity_at(at)[0] for s in pair] for pair in (mine, other))
    change, other_change = after - before, other_after - other_before
    variance, other_variance = (
        sum((s.velocity_variance(s.track.noise) for s in pair), _noise(*pair) ** 2) for pair in (mine, other)
    )
    away = (p - q) / max(float(np.hypot(*(p - q))), 1e-9)
    approach = before - other_before
    rotates = any(pair[0].shape.solid == "box" for pair in (mine, other))
    best = np.inf
    for ratio in ratios:
        # The impulse (per mass of the first object) that explains both changes best, then the nearest one that is allowed.
        weight, other_weight = 1 / variance, ratio**2 / other_variance
        impulse = (weight * change - other_weight / ratio * other_change) / (weight + other_weight)
        size = float(np.hypot(*impulse))
        normal = impulse / size if size > 0 else away
        if normal @ away < MIN_ALONG:
            normal, size = away, max(float(impulse @ away), 0.0)
        # The direction of a small impulse is not well known, and so neither is the approach speed along it.
        closing, across = -float(approach @ normal), float(np.hypot(*(approach - (approach @ normal) * normal)))
        off_by = 2 * across * min(float(min(variance, other_variance)) ** 0.5 / max(size, 1e-9), 1.0)
        least, most = (max(closing + sign * off_by, 0.0) / (1 + ratio) for sign in (-1, 1))
        size = min(max(size, 0.0 if rotates else least), (1 + max_restitution) * most)
        impulse = size * normal
        off, other_off = change - impulse, other_change + ratio * impulse
        best = min(best, float(off @ off) / (2 * variance) + float(other_off @ other_off) / (2 * other_variance))
    closing = -float(approach @ away)
    apart = float((after - other_after) @ away)
    return best, apart / max(closing, min_closing)


def _noise(before: TrackStretch, after: TrackStretch) -> float:
    """Standard deviation of the change of velocity between two stretches, in addition to errors of the fits (world units/s)."""
    if before.b < after.a or Break(before, after).hidden_frames > JUMP_FRAMES:
        return UNSEEN_NOISE_WORLD_PER_S * before.track.scales.speed
    return kick_noise(before)
