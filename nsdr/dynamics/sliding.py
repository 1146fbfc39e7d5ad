"""Free sliding: the law of deceleration in closed form, and its fit to stretches of a track. Compiled by Numba.

CLEVRER's objects slide in straight lines, and their speed v changes by dv/dt = -(a + k v + k v²), where a is friction times
gravity (0 for spheres) and k is Bullet's linear damping. The solution is a tangent for cubes and cylinders, and an exponential
for spheres. A fit of this law gives more exact speeds than differences of positions.
"""

import numpy as np

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.validation import FloatArray
from nsdr.world.physics_constants import FRAME_SECONDS, LINEAR_DAMPING, SLIDING_DECELERATION
from nsdr.world.vocabulary import SHAPES

MAX_SPEED_WORLD_PER_S = 6.0
"""Upper limit of speeds, also when motion is traced back in time (world units/s); twice CLEVRER's fastest initial speed."""
NOISE_WORLD = 0.01
"""Noise of positions (world units). Residuals above three times this value are weighted down."""
ROUNDS = 8
"""Rounds of iteratively reweighted least squares in a fit."""
MIN_WEIGHT = 1e-3
"""Smallest weight of a position in a fit, so that the fit is never singular."""
_MIN_SPEED_WORLD_PER_S = 1e-9
"""Bodies slower than this are at rest (world units/s)."""
_MIN_SPREAD = 1e-12
"""If the weighted sum of squared times from their mean is below this, the speed is unknown and set to 0 (s²)."""
_SPHERE = SHAPES.index("sphere")
_ROOT = np.sqrt(4 * SLIDING_DECELERATION * LINEAR_DAMPING - LINEAR_DAMPING**2)
_REST_ANGLE = np.arctan(LINEAR_DAMPING / _ROOT)
_MAX_ANGLE = np.arctan((2 * LINEAR_DAMPING * MAX_SPEED_WORLD_PER_S + LINEAR_DAMPING) / _ROOT)
_MAX_RATIO = MAX_SPEED_WORLD_PER_S / (1 + MAX_SPEED_WORLD_PER_S)


@cached_njit
def slide_one(shape, speed, seconds):  # type: ignore[no-untyped-def]
    """Distance slid (world units), final speed (world units/s), and the derivatives of both with respect to the initial speed.

    Args:
        shape: index into `nsdr.world.vocabulary.SHAPES`.
        speed: speed at time 0 (world units/s).
        seconds: time, positive for later and negative for earlier.
    """
    k = LINEAR_DAMPING
    if speed < _MIN_SPEED_WORLD_PER_S:
        if shape == _SPHERE:
            return 0.0, 0.0, seconds, 1.0
        return 0.0, 0.0, 0.0, 0.0
    if shape == _SPHERE:
        ratio = min(speed / (1 + speed) * np.exp(-k * seconds), _MAX_RATIO)
        later = ratio / (1 - ratio)
        loss = k * speed * (1 + speed)
        return np.log((1 + speed) / (1 + later)) / k, later, (speed - later) / loss, k * later * (1 + later) / loss
    loss = SLIDING_DECELERATION + k * speed + k * speed * speed
    angle = np.arctan((2 * k * speed + k) / _ROOT)
    final = min(angle - _ROOT * seconds / 2, _MAX_ANGLE)
    if final <= _REST_ANGLE:
        distance = np.log(loss / SLIDING_DECELERATION) / (2 * k) - (angle - _REST_ANGLE) / _ROOT
        return distance, 0.0, speed / loss, 0.0
    later = (_ROOT * np.tan(final) - k) / (2 * k)
    loss_later = SLIDING_DECELERATION + k * later + k * later * later
    distance = np.log(loss / loss_later) / (2 * k) - (angle - final) / _ROOT
    return distance, later, (speed - later) / loss, loss_later / loss


@cached_njit
def _slide_all(shape, speed, seconds, distance, final):  # type: ignore[no-untyped-def]
    """Write the distances slid (N,) and the final speeds (N,) for speeds (N,) and times (N,) to `distance` and `final`."""
    for k in range(len(speed)):
        distance[k], final[k], _, _ = slide_one(shape, min(speed[k], MAX_SPEED_WORLD_PER_S), seconds[k])


def slide(shape: str, speed: FloatArray, seconds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distance that freely sliding objects cover (world units), and their final speed (world units/s).

    Args:
        shape: "cube", "sphere" or "cylinder".
        speed: (N, …) speeds at time 0 (world units/s), or a scalar.
        seconds: simulated time, positive for later and negative for earlier; broadcast against `speed`.
    """
    speed, seconds = np.broadcast_arrays(np.asarray(speed, float), np.asarray(seconds, float))
    distance, final = np.empty(speed.size), np.empty(speed.size)
    _slide_all(SHAPES.index(shape), speed.flatten(), seconds.flatten(), distance, final)
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
def slide_on_ground(shape, speed, seconds, extra, onset, end):  # type: ignore[no-untyped-def]
    """Distances slid (N,) and final speeds (N,) on a ground whose deceleration differs for a while, in time steps of a frame.

    Args:
        shape: index into `nsdr.world.vocabulary.SHAPES`.
        speed: speed at second 0 (world units/s).
        seconds: (N,) times in ascending order.
        extra: deceleration from `onset` to `end` in addition to that on CLEVRER's ground (world units/s²); may be negative.
        onset: start of the additional deceleration (s, 0 or more).
        end: end of the additional deceleration (s, `onset` or later).
    """
    distances, speeds = np.empty(len(seconds)), np.empty(len(seconds))
    law = 0.0 if shape == _SPHERE else SLIDING_DECELERATION
    speed = min(speed, MAX_SPEED_WORLD_PER_S)
    covered, now, _, _ = slide_one(shape, speed, onset)
    at = onset
    for k in range(len(seconds)):
        if seconds[k] <= onset:
            distances[k], speeds[k], _, _ = slide_one(shape, speed, seconds[k])
            continue
        while at < min(seconds[k], end):
            step = min(min(seconds[k], end) - at, FRAME_SECONDS)
            later = max(now - step * (law + extra + LINEAR_DAMPING * now * (1 + now)), 0.0) if now > 0 else 0.0
            covered += step * (now + later) / 2
            now, at = min(later, MAX_SPEED_WORLD_PER_S), at + step
        more, speeds[k], _, _ = slide_one(shape, now, max(seconds[k] - end, 0.0))
        distances[k] = covered + more
    return distances, speeds


@cached_njit
def fit_sliding(shape, seconds, location, weight):  # type: ignore[no-untyped-def]
    """Fit free sliding robustly: position and velocity (4,) at second 0, and the residuals (N,), distances from the fit.

    Args:
        shape: index into `nsdr.world.vocabulary.SHAPES`.
        seconds: (N,) times of the positions in ascending order.
        location: (N, 2) measured positions (world units).
        weight: (N,) weight of each position, 0-1.
    """
    n = len(seconds)
    motion, lag, residual, weights = np.zeros(4), np.zeros((n, 2)), np.empty(n), np.maximum(weight, MIN_WEIGHT)
    for _ in range(ROUNDS):
        speed = np.sqrt(motion[2] ** 2 + motion[3] ** 2)
        for t in range(n):  # lag: displacement minus that at constant velocity; 0 in the first round
            distance = slide_one(shape, min(speed, MAX_SPEED_WORLD_PER_S), seconds[t])[0]
            share = distance / speed - seconds[t] if speed > _MIN_SPEED_WORLD_PER_S else 0.0
            lag[t, 0], lag[t, 1] = share * motion[2], share * motion[3]
        motion = _line(seconds, location, lag, weights)
        for t in range(n):
            x = location[t, 0] - lag[t, 0] - motion[0] - seconds[t] * motion[2]
            y = location[t, 1] - lag[t, 1] - motion[1] - seconds[t] * motion[3]
            residual[t] = np.sqrt(x * x + y * y)
            weights[t] = max(weight[t], MIN_WEIGHT) / (1 + (residual[t] / (3 * NOISE_WORLD)) ** 2)
    return motion, residual
