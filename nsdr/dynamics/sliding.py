"""Free sliding: the law of deceleration in closed form, and its fit to stretches of a track. Compiled by Numba.

Objects slide in straight lines, and their speed v changes by dv/dt = -(a + k v + k v²), where a is friction times gravity and k
is Bullet's linear damping. The solution is a tangent where friction is stronger than damping (a > k/4), as for CLEVRER's cubes
and cylinders; otherwise the ratio (v - v₁) / (v - v₂) decays, where v₁ and v₂ are the roots of a + k v + k v², as for spheres,
for which a is 0; and without damping it is a straight line. A fit of this law gives more exact speeds than differences of
positions.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.types import SceneObject
from nsdr.validation import FloatArray
from nsdr.world.physics import Physics
from nsdr.world.vocabulary import Material, Shape
from nsdr.world.world import Scales, World

NOISE_WORLD = 0.01
"""Noise of positions (world units in CLEVRER). Residuals above three times this value are weighted down."""
ROUNDS = 8
"""Rounds of iteratively reweighted least squares in a fit."""
MIN_WEIGHT = 1e-3
"""Smallest weight of a position in a fit, so that the fit is never singular."""
NEAR_CRITICAL = 1e-6
"""Friction this close to a quarter of damping, as a share of it, counts as this much stronger: no solution is exact there."""
_MIN_SPEED_WORLD_PER_S = 1e-9
"""Bodies slower than this are at rest (world units/s)."""
_MIN_SPREAD = 1e-12
"""If the weighted sum of squared times from their mean is below this, the speed is unknown and set to 0 (s²)."""

LAW = np.dtype(
    [
        (name, float)
        for name in (
            "deceleration",  # a: by friction (world units/s²)
            "damping",  # k (1/s)
            "root",  # √(4 a k - k²), or 0 where the solution is no tangent
            "rest_angle",  # the angle whose tangent stands for rest
            "max_angle",  # and for the highest speed
            "upper",  # v₁, 0 without friction, and v₂ (world units/s)
            "lower",
            "rate",  # k (v₁ - v₂), at which the ratio decays, or 0 where the solution is none (1/s)
            "rest_ratio",  # the ratio at rest
            "max_ratio",  # and at the highest speed
            "max_speed",  # upper limit of speeds, also when motion is traced back (world units/s): twice the fastest start
            "frame_seconds",  # time between two frames (s)
            "noise",  # `NOISE_WORLD` of the world
        )
    ],
    align=True,
)
"""How a body slides, as compiled functions read it."""
Law = np.void
"""A record of the type `LAW`."""


def law_of(o: SceneObject, world: World) -> Law:
    """How an object slides on the table of its world."""
    words = world.vocabulary
    return sliding_law(words.shape(o.shape), words.material(o.material), world.physics, world.scales)


@lru_cache(maxsize=256)
def sliding_law(shape: Shape, material: Material, physics: Physics, scales: Scales) -> Law:
    """How an object with a shape and a material slides."""
    a, k = shape.friction * material.friction * physics.gravity, physics.linear_damping
    fastest = 2 * physics.start_speed_world_per_s[1]
    numbers = dict[str, Any].fromkeys(LAW.names or (), 0.0)
    if k and abs(a - k / 4) <= NEAR_CRITICAL * k / 4:
        a = k / 4 * (1 + NEAR_CRITICAL)
    if k and a > k / 4:
        root = np.sqrt(4 * a * k - k**2)
        angles = {"rest_angle": np.arctan(k / root), "max_angle": np.arctan((2 * k * fastest + k) / root)}
        numbers |= {"root": root, **angles}
    elif k:
        apart = np.sqrt(1 - 4 * a / k)
        upper, lower = (apart - 1) / 2, (-apart - 1) / 2
        rest, most = -upper / -lower, (fastest - upper) / (fastest - lower)
        numbers |= {"upper": upper, "lower": lower, "rate": k * apart, "rest_ratio": rest, "max_ratio": most}
    numbers |= {"deceleration": a, "damping": k, "max_speed": fastest, "frame_seconds": physics.frame_seconds}
    numbers |= {"noise": NOISE_WORLD * scales.size}
    return np.array([tuple(numbers.values())], LAW)[0]


@cached_njit
def slide_one(law, speed, seconds):  # type: ignore[no-untyped-def]
    """Distance slid (world units), final speed (world units/s), and the derivatives of both with respect to the initial speed.

    Args:
        law: a record of `LAW`.
        speed: speed at time 0 (world units/s).
        seconds: time, positive for later and negative for earlier.
    """
    a, k = law.deceleration, law.damping
    if speed < _MIN_SPEED_WORLD_PER_S:
        if a == 0.0:
            return 0.0, 0.0, seconds, 1.0
        return 0.0, 0.0, 0.0, 0.0
    if law.root > 0.0:
        root, rest = law.root, law.rest_angle
        loss = a + k * speed + k * speed * speed
        angle = np.arctan((2 * k * speed + k) / root)
        final = min(angle - root * seconds / 2, law.max_angle)
        if final <= rest:
            distance = np.log(loss / a) / (2 * k) - (angle - rest) / root
            return distance, 0.0, speed / loss, 0.0
        later = (root * np.tan(final) - k) / (2 * k)
        loss_later = a + k * later + k * later * later
        distance = np.log(loss / loss_later) / (2 * k) - (angle - final) / root
        return distance, later, (speed - later) / loss, loss_later / loss
    if law.rate > 0.0:
        v1, v2 = law.upper, law.lower
        ratio = min((speed - v1) / (speed - v2) * np.exp(-law.rate * seconds), law.max_ratio)
        later = (v1 - ratio * v2) / (1 - ratio) if ratio > law.rest_ratio else 0.0
        distance = -v2 * np.log((speed - v2) / (later - v2))
        if v1 < 0.0:
            distance += v1 * np.log((speed - v1) / (later - v1))
        loss = k * (speed - v1) * (speed - v2)
        final_by_speed = k * (later - v1) * (later - v2) / loss if later > 0.0 else 0.0
        return distance / law.rate, later, (speed - later) / loss, final_by_speed
    if a == 0.0:
        return speed * seconds, speed, seconds, 1.0
    later = min(speed - a * seconds, law.max_speed)
    if later <= 0.0:
        return speed * speed / (2 * a), 0.0, speed / a, 0.0
    return (speed + later) * (speed - later) / (2 * a), later, (speed - later) / a, 1.0


@cached_njit
def _slide_all(law, speed, seconds, distance, final):  # type: ignore[no-untyped-def]
    """Write the distances slid (N,) and the final speeds (N,) for speeds (N,) and times (N,) to `distance` and `final`."""
    for k in range(len(speed)):
        distance[k], final[k], _, _ = slide_one(law, min(speed[k], law.max_speed), seconds[k])


def slide(law: Law, speed: FloatArray, seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance that freely sliding objects cover (world units), and their final speed (world units/s).

    Args:
        law: how the objects slide.
        speed: (N, …) speeds at time 0 (world units/s), or a scalar.
        seconds: simulated time, positive for later and negative for earlier; broadcast against `speed`.
    """
    speed, seconds = np.broadcast_arrays(np.asarray(speed, float), np.asarray(seconds, float))
    distance, final = np.empty(speed.size), np.empty(speed.size)
    _slide_all(law, speed.flatten(), seconds.flatten(), distance, final)
    return distance.reshape(speed.shape), final.reshape(speed.shape)


@cached_njit
def _line(seconds, location, lag, weight):  # type: ignore[no-untyped-def]
    """Position and velocity (4,) at second 0 on the weighted least-squares line through `location` - `lag` (N, 2)."""
    total, first, second = 0.0, 0.0, 0.0
    sums = np.zeros((2, 2))
    for t in range(len(seconds)):
        w, s = weight[t], seconds[t]
        total += w
        first += w * s
        second += w * s * s
        for k in range(2):
            value = location[t, k] - lag[t, k]
            sums[0, k] += w * value
            sums[1, k] += w * s * value
    mean = first / total
    spread = second - first * mean
    out = np.empty(4)
    for k in range(2):
        slope = (sums[1, k] - mean * sums[0, k]) / spread if spread > _MIN_SPREAD else 0.0
        out[k], out[2 + k] = sums[0, k] / total - slope * mean, slope
    return out


@cached_njit
def slide_on_ground(law, speed, seconds, extra, onset, end):  # type: ignore[no-untyped-def]
    """Distances slid (N,) and final speeds (N,) on a ground whose deceleration differs for a while, in time steps of a frame.

    Args:
        law: a record of `LAW`.
        speed: speed at second 0 (world units/s).
        seconds: (N,) times in ascending order.
        extra: deceleration from `onset` to `end` in addition to the law's (world units/s²); may be negative.
        onset: start of the additional deceleration (s, 0 or more).
        end: end of the additional deceleration (s, `onset` or later).
    """
    distances, speeds = np.empty(len(seconds)), np.empty(len(seconds))
    speed = min(speed, law.max_speed)
    covered, now, _, _ = slide_one(law, speed, onset)
    at = onset
    for k in range(len(seconds)):
        if seconds[k] <= onset:
            distances[k], speeds[k], _, _ = slide_one(law, speed, seconds[k])
            continue
        while at < min(seconds[k], end):
            step = min(min(seconds[k], end) - at, law.frame_seconds)
            later = (
                max(now - step * (law.deceleration + extra + law.damping * now * (1 + now)), 0.0) if now > 0 else 0.0
            )
            covered += step * (now + later) / 2
            now, at = min(later, law.max_speed), at + step
        more, speeds[k], _, _ = slide_one(law, now, max(seconds[k] - end, 0.0))
        distances[k] = covered + more
    return distances, speeds


@cached_njit
def fit_sliding(law, seconds, location, weight):  # type: ignore[no-untyped-def]
    """Fit free sliding robustly: position and velocity (4,) at second 0, and the residuals (N,), distances from the fit.

    Args:
        law: a record of `LAW`.
        seconds: (N,) times of the positions in ascending order.
        location: (N, 2) measured positions (world units).
        weight: (N,) weight of each position, 0-1.
    """
    n = len(seconds)
    motion, lag, residual, weights = np.zeros(4), np.zeros((n, 2)), np.empty(n), np.maximum(weight, MIN_WEIGHT)
    for _ in range(ROUNDS):
        speed = np.sqrt(motion[2] ** 2 + motion[3] ** 2)
        for t in range(n):  # lag: displacement minus that at constant velocity; 0 in the first round
            distance = slide_one(law, min(speed, law.max_speed), seconds[t])[0]
            share = distance / speed - seconds[t] if speed > _MIN_SPEED_WORLD_PER_S else 0.0
            lag[t, 0], lag[t, 1] = share * motion[2], share * motion[3]
        motion = _line(seconds, location, lag, weights)
        for t in range(n):
            x = location[t, 0] - lag[t, 0] - motion[0] - seconds[t] * motion[2]
            y = location[t, 1] - lag[t, 1] - motion[1] - seconds[t] * motion[3]
            residual[t] = np.sqrt(x * x + y * y)
            weights[t] = max(weight[t], MIN_WEIGHT) / (1 + (residual[t] / (3 * law.noise)) ** 2)
    return motion, residual
