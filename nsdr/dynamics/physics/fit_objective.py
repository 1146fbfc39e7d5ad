"""The objective of the fit: parameters -> robust cost of the tracks, its gradient and curvature, in one compiled call.

The curvature is that of Gauss and Newton. Both are gathered segment by segment: within a segment every residual depends on the
six numbers of the state at its start, so a segment's data are summed in six dimensions and carried to the parameters once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import CUBE, CUBE_OUTLINE
from nsdr.dynamics.physics.sensitive_run import (
    advance,
    exchange,
    find_contact,
    new_bodies,
    slide_derivatives,
    spin_derivatives,
    start_segment,
    state_at,
)
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.physics_constants import FRAME_SECONDS, OBJECT_RADIUS_WORLD, STEP_SECONDS, STEPS_PER_FRAME

__all__ = ["EDGES_PX", "MAX_FITTED_REBOUND", "FitProblem", "cube_edges_px", "evaluate"]

MAX_FITTED_REBOUND = 0.8
"""Largest rebound that a fit can have (Bullet's restitution is 0.64)."""
EDGES_PX = (-0.3, -0.6)
"""Left and right edges of real masks of cubes lie this much beside those of the drawn outline (medians of ten scenes)."""
_COLUMN, _DEPTH = CLEVRER_CAMERA.matrix[0].copy(), CLEVRER_CAMERA.matrix[2].copy()
"""Rows of the projection as contiguous arrays, which Numba compiles in."""
_MIN_DEPTH_WORLD = 0.1
"""Nearest depth that is projected (world units)."""


class FitProblem(NamedTuple):
    """What was measured, and what each parameter stands for. Parameters are in units of `unit`.

    Attributes:
        shape: (n,) int, index into `nsdr.world.vocabulary.SHAPES`.
        reference_s: (n,) seconds, when positions and velocities are those of the parameters.
        first: (n + 1,) int, first datum of each object.
        frame: (D,) int, in order within an object.
        position: (D, 2) world units.
        root_weight: (D,) square roots of the weights.
        edges_px: (D, 2) left and right edges of cubes' boxes.
        unit: (P,) of the parameters.
        position_at, velocity_at, log_mass_at, yaw_at: (n,) int, each object's (first) parameter of that kind; -1 for none.
        rebound_at: (n, n) int, parameter of the pair's rebound; -1 for none.
        prior: (P, 2) mean and standard deviation; infinite without a prior.
        rebound: of pairs without a parameter.
        position_noise_world, edge_noise_px: standard deviations of the data.
        robust_scale: residuals beyond this many standard deviations are weighted down (soft L1).
    """

    shape: NDArray[np.int64]
    reference_s: NDArray[np.float64]
    first: NDArray[np.int64]
    frame: NDArray[np.int64]
    position: NDArray[np.float64]
    root_weight: NDArray[np.float64]
    edges_px: NDArray[np.float64]
    unit: NDArray[np.float64]
    position_at: NDArray[np.int64]
    velocity_at: NDArray[np.int64]
    log_mass_at: NDArray[np.int64]
    yaw_at: NDArray[np.int64]
    rebound_at: NDArray[np.int64]
    prior: NDArray[np.float64]
    rebound: float
    position_noise_world: float
    edge_noise_px: float
    robust_scale: float


class Sums(NamedTuple):
    """What is gathered along a run; arrays that the functions below change.

    Attributes:
        loss: (2,) sum of the robust losses, and number of residuals.
        gradient: (P,) of the sum.
        curvature: (P, P) of the sum.
        motion: (n, F, 6) states at every frame.
        next_frame: (n,) int, first frame that was not gathered yet.
        next_datum: (n,) int, the same for data.
    """

    loss: NDArray[np.float64]
    gradient: NDArray[np.float64]
    curvature: NDArray[np.float64]
    motion: NDArray[np.float64]
    next_frame: NDArray[np.int64]
    next_datum: NDArray[np.int64]


@cached_njit
def _corner_column(x, y, c, s, k):  # type: ignore[no-untyped-def]
    """Image column and depth of one of the 56 corners of a cube's hull; odd ones are on top."""
    kx, ky, z = CUBE_OUTLINE[k // 2, 0], CUBE_OUTLINE[k // 2, 1], 2 * OBJECT_RADIUS_WORLD * (k % 2)
    px, py = x + c * kx - s * ky, y + s * kx + c * ky
    depth = max(_DEPTH[0] * px + _DEPTH[2] * z + _DEPTH[3], _MIN_DEPTH_WORLD)
    return (_COLUMN[0] * px + _COLUMN[1] * py + _COLUMN[2] * z + _COLUMN[3]) / depth, depth


@cached_njit
def cube_edges_px(x, y, yaw, derivatives):  # type: ignore[no-untyped-def]
    """Left and right edges of a cube's image; their derivatives by x, y and yaw go to `derivatives` (2, 3)."""
    c, s = np.cos(yaw), np.sin(yaw)
    left, right, left_at, right_at = 1e9, -1e9, 0, 0
    for k in range(2 * len(CUBE_OUTLINE)):
        column = _corner_column(x, y, c, s, k)[0]
        if column < left:
            left, left_at = column, k
        if column > right:
            right, right_at = column, k
    for side in range(2):
        k = right_at if side else left_at
        column, depth = _corner_column(x, y, c, s, k)
        by_x, by_y = (_COLUMN[0] - column * _DEPTH[0]) / depth, _COLUMN[1] / depth
        kx, ky = CUBE_OUTLINE[k // 2, 0], CUBE_OUTLINE[k // 2, 1]
        derivatives[side, 0], derivatives[side, 1] = by_x, by_y
        derivatives[side, 2] = by_x * (-s * kx - c * ky) + by_y * (c * kx - s * ky)
    return left + EDGES_PX[0], right + EDGES_PX[1]


@cached_njit
def _add(residual, scale, row, loss, force, curvature):  # type: ignore[no-untyped-def]
    """Add a residual with derivatives `row` to the sums of soft L1 losses; the curvature is that of the loss itself."""
    root = np.sqrt(1 + (residual / scale) ** 2)
    loss[0] += scale * scale * (root - 1)
    loss[1] += 1
    pull, weight = residual / root, 1 / root**3
    for a in range(len(row)):
        if row[a] != 0.0:
            force[a] += pull * row[a]
            for b in range(len(row)):
                curvature[a, b] += weight * row[a] * row[b]


@cached_njit
def _add_datum(p, i, d, state, derivatives, loss, force, curvature):  # type: ignore[no-untyped-def]
    """Add the residuals of datum d of object i, which has a state with derivatives (6, 6), to a segment's sums."""
    row = np.empty(6)
    for k in range(2):
        scale = p.root_weight[d] / p.position_noise_world
        for c in range(6):
            row[c] = derivatives[k, c] * scale
        _add((state[k] - p.position[d, k]) * scale, p.robust_scale, row, loss, force, curvature)
    if p.shape[i] != CUBE:
        return
    scale = p.root_weight[d] / p.edge_noise_px
    by_place = np.empty((2, 3))
    edges = cube_edges_px(state[0], state[1], state[4], by_place)
    for side in range(2):
        for c in range(6):
            moved = by_place[side, 0] * derivatives[0, c] + by_place[side, 1] * derivatives[1, c]
            row[c] = (moved + by_place[side, 2] * derivatives[4, c]) * scale
        _add((edges[side] - p.edges_px[d, side]) * scale, p.robust_scale, row, loss, force, curvature)


@cached_njit
def _carry(sensitivity, active, force, curvature, gradient, total):  # type: ignore[no-untyped-def]
    """Add a segment's sums in six dimensions to those of the parameters."""
    bent = np.empty(6)
    for a in range(len(active)):
        if not active[a]:
            continue
        for r in range(6):
            gradient[a] += force[r] * sensitivity[r, a]
            bent[r] = 0.0
            for c in range(6):
                bent[r] += curvature[r, c] * sensitivity[c, a]
        for b in range(len(active)):
            if active[b]:
                for r in range(6):
                    total[a, b] += bent[r] * sensitivity[r, b]


@cached_njit
def _finish_segment(p, bodies, sums, i, seconds):  # type: ignore[no-untyped-def]
    """Gather the data of body i's segment before a time, and move its start there."""
    begin = sums.next_frame[i]
    end = begin
    while end < sums.motion.shape[1] and end * FRAME_SECONDS < seconds:
        end += 1
    spinning = bodies.end[i] < np.inf
    derivatives = np.empty((end - begin + 1, 6, 6))
    if spinning:
        spin_derivatives(bodies, i, seconds, begin, derivatives)
    force, curvature = np.zeros(6), np.zeros((6, 6))
    for k in range(end - begin + 1):
        when = (begin + k) * FRAME_SECONDS if k < end - begin else seconds
        if not spinning:
            slide_derivatives(bodies.shape[i], bodies.state[i], when - bodies.start[i], derivatives[k])
        if k == end - begin:
            break
        state = sums.motion[i, begin + k]
        state_at(bodies, i, when, state)
        d = sums.next_datum[i]
        if d < p.first[i + 1] and p.frame[d] == begin + k:
            _add_datum(p, i, d, state, derivatives[k], sums.loss, force, curvature)
            sums.next_datum[i] += 1
    sums.next_frame[i] = end
    _carry(bodies.sensitivity[i], bodies.active[i], force, curvature, sums.gradient, sums.curvature)
    advance(bodies, i, seconds, derivatives[end - begin])


@cached_njit
def _start(p, x, horizon):  # type: ignore[no-untyped-def]
    """Bodies of the parameters at their reference frames."""
    bodies = new_bodies(p.shape, len(x), int(horizon / STEP_SECONDS) + 1)
    for i in range(len(p.shape)):
        bodies.start[i] = p.reference_s[i]
        for first, at, count in ((0, p.position_at[i], 2), (2, p.velocity_at[i], 2), (4, p.yaw_at[i], 1)):
            if at >= 0:
                for k in range(count):
                    bodies.state[i, first + k] = x[at + k] * p.unit[at + k]
                    bodies.sensitivity[i, first + k, at + k] = p.unit[at + k]
                    bodies.active[i, at + k] = True
        at = p.log_mass_at[i]
        if at >= 0:
            bodies.mass[i] = np.exp(x[at] * p.unit[at])
    return bodies


@cached_njit
def _contact(p, bodies, x, i, j, touched):  # type: ignore[no-untyped-def]
    """The exchange of bodies i and j; a pair that touched before does not rebound again."""
    parameters, d_mass = np.array([p.log_mass_at[i], p.log_mass_at[j], p.rebound_at[i, j]]), np.zeros(2)
    for k, body in ((0, i), (1, j)):
        if parameters[k] >= 0:
            d_mass[k] = bodies.mass[body] * p.unit[parameters[k]]
    rebound, d_rebound, at = p.rebound, 0.0, parameters[2]
    if at >= 0:
        given = x[at] * p.unit[at]
        rebound = min(max(given, 0.0), MAX_FITTED_REBOUND)
        d_rebound = p.unit[at] if rebound == given else 0.0
    if touched:
        rebound, d_rebound = 0.0, 0.0
    exchange(bodies, i, j, rebound, parameters, d_mass, d_rebound)


@cached_njit
def _search(bodies, i, contacts, last_contact, when, since, horizon):  # type: ignore[no-untyped-def]
    """Write the times of body i's next contacts to `when` (n, n).

    Bodies that press on each other touch again and again: each pair pauses a step longer after each contact.
    """
    for k in range(len(bodies.start)):
        if k != i:
            a, b = min(i, k), max(i, k)
            ready = last_contact[a, b] + contacts[a, b] * STEP_SECONDS
            until = min(horizon, min(bodies.end[a], bodies.end[b]))
            when[a, b] = find_contact(bodies, a, b, max(since, ready), until)


@cached_njit
def _add_priors(p, x, sums):  # type: ignore[no-untyped-def]
    row, force, curvature = np.ones(1), np.zeros(1), np.zeros((1, 1))
    for k in range(len(x)):
        mean, deviation = p.prior[k, 0], p.prior[k, 1]
        if deviation < np.inf:
            row[0], force[0], curvature[0, 0] = p.unit[k] / deviation, 0.0, 0.0
            _add((x[k] * p.unit[k] - mean) / deviation, p.robust_scale, row, sums.loss, force, curvature)
            sums.gradient[k] += force[0]
            sums.curvature[k, k] += curvature[0, 0]


@cached_njit
def _next_event(when, ends):  # type: ignore[no-untyped-def]
    """Time of the next contact of a pair (n, n) or end of a spinning segment (n,), and the one or two bodies concerned."""
    now, a, b = np.inf, 0, 0
    for i in range(len(ends)):
        if ends[i] < now:
            now, a, b = ends[i], i, i
        for j in range(i + 1, len(ends)):
            if when[i, j] < now:
                now, a, b = when[i, j], i, j
    return now, a, b


@cached_njit
def evaluate(p, x, n_frames):  # type: ignore[no-untyped-def]
    """Mean robust loss of the residuals of frames below `n_frames`, its derivatives, and the run.

    Args:
        p: a `FitProblem`.
        x: (P,) parameters.
        n_frames: of the run.

    Returns:
        The mean loss; its gradient (P,) and curvature (P, P); states (n, n_frames, 6); frames (n, n) of first contacts,
        `NO_CONTACT` for none.
    """
    n, horizon = len(p.shape), (n_frames - 1) * FRAME_SECONDS
    bodies = _start(p, x, horizon)
    sums = Sums(
        np.zeros(2),
        np.zeros(len(x)),
        np.zeros((len(x), len(x))),
        np.empty((n, n_frames, 6)),
        np.zeros(n, np.int64),
        p.first[:-1].copy(),
    )
    first_contact, contacts = np.full((n, n), NO_CONTACT), np.zeros((n, n), np.int64)
    last_contact, when = np.full((n, n), -np.inf), np.full((n, n), np.inf)
    concerned, now = np.ones(n, np.bool_), 0.0
    while True:
        for i in range(n):
            if concerned[i]:
                _search(bodies, i, contacts, last_contact, when, now, horizon)
        now, a, b = _next_event(when, bodies.end)
        last = now >= horizon
        if last:
            now = horizon + STEP_SECONDS / 2
        for i in range(n):
            concerned[i] = last or i in (a, b)
            if concerned[i]:
                _finish_segment(p, bodies, sums, i, now)
        if last:
            break
        if a != b:
            _contact(p, bodies, x, a, b, contacts[a, b] > 0)
            if contacts[a, b] == 0:
                step = int(now / STEP_SECONDS) + 1
                first_contact[a, b] = first_contact[b, a] = int(step / STEPS_PER_FRAME + 0.5)
            contacts[a, b] += 1
            last_contact[a, b] = now
        for i in range(n):
            if concerned[i]:
                start_segment(bodies, i, now, horizon)
    _add_priors(p, x, sums)
    for a in range(len(x)):
        sums.gradient[a] /= sums.loss[1]
        for b in range(len(x)):
            sums.curvature[a, b] /= sums.loss[1]
    return sums.loss[0] / sums.loss[1], sums.gradient, sums.curvature, sums.motion, first_contact
