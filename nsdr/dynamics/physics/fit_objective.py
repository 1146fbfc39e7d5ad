"""The objective of the fit: parameters -> robust cost of the tracks, its gradient and curvature, in one compiled call.

The curvature is that of Gauss and Newton. Both are gathered segment by segment: within a segment every residual depends on the
six numbers of the state at its start, so a segment's data are summed in six dimensions and carried to the parameters once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit
from nsdr.dynamics.physics.contact_geometry import CUBE, CUBE_CYCLE, CUBE_OUTLINE
from nsdr.dynamics.physics.sensitive_run import (
    advance,
    copy_state,
    exchange,
    find_contact,
    new_bodies,
    slide_derivatives,
    spin_derivatives,
    start_segment,
    state_at,
)
from nsdr.dynamics.physics.simulator import NO_CONTACT
from nsdr.world.camera import Camera
from nsdr.world.physics_constants import FRAME_SECONDS, OBJECT_RADIUS_WORLD, STEP_SECONDS, STEPS_PER_FRAME

MAX_FITTED_REBOUND = 0.8
"""Largest rebound that a fit can have (Bullet's restitution is 0.64)."""
REBOUND = 0.4
"""Rebound of pairs that were not expected to collide, and prior mean of the others', as a share of the approach speed. Like
the next three, set on left-out scenes of `train`."""
POSITION_NOISE_WORLD = 0.01
"""Standard deviation of reliable positions (world units)."""
EDGE_NOISE_PX = 2.0
"""Standard deviation of the left and right box edges of cubes, which show their yaw (pixels)."""
ROBUST_SCALE = 2.0
"""Residuals beyond this many standard deviations are weighted down (soft L1)."""
EDGES_PX = (-0.3, -0.6)
"""Left and right edges of real masks of cubes lie this much beside those of the drawn outline (medians of ten scenes)."""
LOG_MASS, PAIR_REBOUND = 6, 7
"""Kinds of parameters beside those of the state (its columns)."""
_OUTLINE = CUBE_OUTLINE[CUBE_CYCLE]
_MIN_DEPTH_WORLD = 0.1
"""Nearest depth that is projected (world units)."""


def rows_of(camera: Camera) -> tuple[float, ...]:
    """(8,) rows of the projection that give an image's columns and depths, as numbers, which Numba reads fastest."""
    return tuple(camera.matrix[[0, 2]].ravel().tolist())


class FitProblem(NamedTuple):
    """What was measured, and what each parameter stands for. Parameters are in units of `unit`.

    Attributes:
        shape: (n,) int, index into `nsdr.world.vocabulary.SHAPES`.
        reference_s: (n,) seconds, when positions and velocities are those of the parameters.
        position, root_weight, edges_px: (n, F, 2), (n, F) and (n, F, 2), measured positions, square roots of their weights, 0
            where nothing was measured, and left and right edges of boxes, of which those of cubes count.
        parameters: (P, 3) int, a column of the state of an object, `LOG_MASS` or `PAIR_REBOUND`; the object; and for
            rebounds the other object.
        unit: (P,) of the parameters.
        prior: (P, 2) mean and standard deviation; infinite without a prior.
        projection: see `rows_of`.
    """

    shape: NDArray[np.int64]
    reference_s: NDArray[np.float64]
    position: NDArray[np.float64]
    root_weight: NDArray[np.float64]
    edges_px: NDArray[np.float64]
    parameters: NDArray[np.int64]
    unit: NDArray[np.float64]
    prior: NDArray[np.float64]
    projection: tuple[float, ...]


class Sums(NamedTuple):
    """What is gathered along a run; arrays that the functions below change.

    Attributes:
        loss: (2,) sum of the robust losses, and number of residuals.
        gradient, curvature: (P,) and (P, P) of that sum.
        motion: (n, F, 6) states at every frame.
        next_frame: (n,) the first frame of each object that is not gathered yet.
        outermost: (n, 2, 2) outermost points of each cube's image in the last frame, see `cube_edges_px`.
    """

    loss: NDArray[np.float64]
    gradient: NDArray[np.float64]
    curvature: NDArray[np.float64]
    motion: NDArray[np.float64]
    next_frame: NDArray[np.int64]
    outermost: NDArray[np.int64]


@cached_njit
def _column(projection, x, y, c, s, k, z):  # type: ignore[no-untyped-def]
    """Image column and depth of point k of a cube's outline at a height."""
    kx, ky = _OUTLINE[k, 0], _OUTLINE[k, 1]
    px, py = x + c * kx - s * ky, y + s * kx + c * ky
    depth = projection[4] * px + projection[5] * py + projection[6] * z + projection[7]
    depth = max(depth, _MIN_DEPTH_WORLD)
    column = projection[0] * px + projection[1] * py + projection[2] * z + projection[3]
    return column / depth, depth


@cached_njit
def cube_edges_px(projection, x, y, yaw, start, derivatives):  # type: ignore[no-untyped-def]
    """Left and right edges of a cube's image.

    The outline is convex, so its outermost points are found by climbing along it.

    Args:
        projection: see `rows_of`.
        x, y, yaw: of the cube (world units, radians).
        start: (2, 2) int, points of the left and right edges, below and above, where the climb begins; changed to the result.
        derivatives: (2, 3), filled with those of the edges by x, y and yaw.
    """
    c, s, n = np.cos(yaw), np.sin(yaw), len(_OUTLINE)
    edges = (np.inf, np.inf)
    for side in range(2):
        sign, best = (1.0 if side else -1.0), -np.inf
        for top in range(2):
            k, z = start[side, top], 2 * OBJECT_RADIUS_WORLD * top
            column, depth = _column(projection, x, y, c, s, k, z)
            for turn in (1, n - 1):
                while True:
                    following = (k + turn) % n
                    other, other_depth = _column(projection, x, y, c, s, following, z)
                    if sign * other <= sign * column:
                        break
                    k, column, depth = following, other, other_depth
            start[side, top] = k
            if sign * column > best:
                best = sign * column
                by_x = (projection[0] - column * projection[4]) / depth
                by_y = (projection[1] - column * projection[5]) / depth
                kx, ky = _OUTLINE[k, 0], _OUTLINE[k, 1]
                derivatives[side, 0], derivatives[side, 1] = by_x, by_y
                derivatives[side, 2] = by_x * (-s * kx - c * ky) + by_y * (c * kx - s * ky)
        edges = (edges[1], sign * best)
    return edges[0] + EDGES_PX[0], edges[1] + EDGES_PX[1]


@cached_njit
def _soft_l1(residual):  # type: ignore[no-untyped-def]
    """Robust loss of a residual, and its first and second derivative."""
    root = np.sqrt(1 + (residual / ROBUST_SCALE) ** 2)
    return ROBUST_SCALE * ROBUST_SCALE * (root - 1), residual / root, 1 / (root * root * root)


@cached_njit
def _add_datum(  # type: ignore[no-untyped-def]
    is_cube,
    projection,
    position,
    edges_px,
    root_weight,
    state,
    derivatives,
    scratch,
    outermost,
    loss,
    force,
    curvature,
):
    """Add the residuals of a datum, measured (2,) and (2,), to a segment's sums of losses, their number, and derivatives.

    They depend on place and yaw, so they are summed over these first, in `scratch` (6, 3). `derivatives` (6, 6) are of the
    run's state by that at the segment's start.
    """
    pull, bend, by_place = scratch[0], scratch[1:4], scratch[4:6]
    for a in range(3):
        pull[a] = bend[a, 0] = bend[a, 1] = bend[a, 2] = 0.0
    scale = root_weight / POSITION_NOISE_WORLD
    for k in range(2):
        value, first, second = _soft_l1((state[k] - position[k]) * scale)
        loss[0] += value
        pull[k] += first * scale
        bend[k, k] += second * scale * scale
    loss[1] += 2
    if is_cube:
        scale = root_weight / EDGE_NOISE_PX
        edges = cube_edges_px(projection, state[0], state[1], state[4], outermost, by_place)
        for side in range(2):
            value, first, second = _soft_l1((edges[side] - edges_px[side]) * scale)
            loss[0] += value
            for a in range(3):
                pull[a] += first * scale * by_place[side, a]
                for b in range(3):
                    bend[a, b] += second * scale * scale * by_place[side, a] * by_place[side, b]
        loss[1] += 2
    for a in range(6):
        by_x, by_y, by_yaw = derivatives[0, a], derivatives[1, a], derivatives[4, a]
        force[a] += pull[0] * by_x + pull[1] * by_y + pull[2] * by_yaw
        bent_x = bend[0, 0] * by_x + bend[0, 1] * by_y + bend[0, 2] * by_yaw
        bent_y = bend[1, 0] * by_x + bend[1, 1] * by_y + bend[1, 2] * by_yaw
        bent_yaw = bend[2, 0] * by_x + bend[2, 1] * by_y + bend[2, 2] * by_yaw
        for b in range(6):
            curvature[a, b] += bent_x * derivatives[0, b] + bent_y * derivatives[1, b] + bent_yaw * derivatives[4, b]


@cached_njit
def _carry(sensitivity, force, curvature, gradient, total):  # type: ignore[no-untyped-def]
    """Add a segment's sums in six dimensions to those of the parameters."""
    bent = np.empty(6)
    for a in range(len(gradient)):
        for r in range(6):
            gradient[a] += force[r] * sensitivity[r, a]
            bent[r] = 0.0
            for c in range(6):
                bent[r] += curvature[r, c] * sensitivity[c, a]
        for b in range(len(gradient)):
            for r in range(6):
                total[a, b] += bent[r] * sensitivity[r, b]


@cached_njit
def _finish_segment(p, bodies, sums, i, seconds):  # type: ignore[no-untyped-def]
    """Gather the data of body i's segment before a time, and move its start there."""
    positions, edges_px, root_weight, projection = p.position[i], p.edges_px[i], p.root_weight[i], p.projection
    motion, outermost, loss = sums.motion[i], sums.outermost[i], sums.loss
    shape, state, start, spinning = bodies.shape[i], bodies.state[i], bodies.start[i], bodies.end[i] < np.inf
    begin = end = sums.next_frame[i]
    while end < len(motion) and end * FRAME_SECONDS < seconds:
        end += 1
    derivatives = np.empty((end - begin + 1 if spinning else 1, 6, 6))
    if spinning:
        spin_derivatives(bodies, i, seconds, begin, derivatives)
    force, curvature, after, scratch = np.zeros(6), np.zeros((6, 6)), np.empty(6), np.empty((6, 3))
    for k in range(begin, end + 1):
        when = k * FRAME_SECONDS if k < end else seconds
        here = derivatives[k - begin if spinning else 0]
        if spinning:
            state_at(bodies, i, when, after)
        else:
            slide_derivatives(shape, state, when - start, after, here)
        if k == end:
            _carry(bodies.sensitivity[i], force, curvature, sums.gradient, sums.curvature)
            advance(bodies, i, seconds, after, here)
            break
        copy_state(after, motion[k])
        if root_weight[k] > 0:
            measured = (positions[k], edges_px[k], root_weight[k])
            _add_datum(shape == CUBE, projection, *measured, after, here, scratch, outermost, loss, force, curvature)
    sums.next_frame[i] = end


@cached_njit
def _start(p, x, horizon):  # type: ignore[no-untyped-def]
    """Bodies of the parameters at their reference frames."""
    bodies = new_bodies(p.shape, len(x), int(horizon / STEP_SECONDS) + 1)
    bodies.start[:] = p.reference_s
    for k in range(len(x)):
        kind, i = p.parameters[k, 0], p.parameters[k, 1]
        if kind < LOG_MASS:
            bodies.state[i, kind] = x[k] * p.unit[k]
            bodies.sensitivity[i, kind, k] = p.unit[k]
        elif kind == LOG_MASS:
            bodies.mass[i] = np.exp(x[k] * p.unit[k])
    return bodies


@cached_njit
def _contact(p, bodies, x, i, j, touched):  # type: ignore[no-untyped-def]
    """The exchange of bodies i and j, i < j; a pair that touched before does not rebound again."""
    rebound, by_parameter = REBOUND, np.zeros((3, len(x)))
    for k in range(len(x)):
        kind, one, other = p.parameters[k]
        if kind == LOG_MASS and one in (i, j):
            by_parameter[0 if one == i else 1, k] = bodies.mass[one] * p.unit[k]
        elif kind == PAIR_REBOUND and one == i and other == j:
            given = x[k] * p.unit[k]
            rebound = min(max(given, 0.0), MAX_FITTED_REBOUND)
            by_parameter[2, k] = p.unit[k] if rebound == given else 0.0
    if touched:
        rebound, by_parameter[2] = 0.0, 0.0
    exchange(bodies, i, j, rebound, by_parameter)


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
    for k in range(len(x)):
        mean, deviation = p.prior[k, 0], p.prior[k, 1]
        if deviation < np.inf:
            value, first, second = _soft_l1((x[k] * p.unit[k] - mean) / deviation)
            sums.loss[0] += value
            sums.loss[1] += 1
            sums.gradient[k] += first * p.unit[k] / deviation
            sums.curvature[k, k] += second * (p.unit[k] / deviation) ** 2


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
        np.zeros((n, 2, 2), np.int64),
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
    loss, count = sums.loss
    return loss / count, sums.gradient / count, sums.curvature / count, sums.motion, first_contact
