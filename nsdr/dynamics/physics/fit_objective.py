"""The objective of the fit: the robust cost of the tracks, its gradient and its curvature as functions of the parameters.

cost = mean over residuals r of ρ(r), where r = √weight · (predicted - measured) / noise

The curvature is the Gauss-Newton approximation of the Hessian. Gradient and curvature are summed segment by segment: within a
segment, every residual depends on the six numbers of the state s at its start. So the data of a segment are summed as
derivatives with respect to s, and the chain rule with ∂s/∂parameters (`Bodies.sensitivity`) is applied once per segment.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.numba_cache import cached_njit, inlined_njit
from nsdr.dynamics.physics.body_state import SPIN, STATE_SIZE, YAW, X, Y
from nsdr.dynamics.physics.cube_edges import box_edges_px
from nsdr.dynamics.physics.forces import pair_restitution
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

MAX_FITTED_REBOUND = 1.25
"""Largest rebound of a fit, a ratio of separation speed to approach speed, as a multiple of the pair's coefficient of
restitution: 0.8 in CLEVRER."""
REBOUND = 0.625
"""Rebound of pairs that were not expected to collide, and prior mean of the rebound of the others, as a multiple of the same:
0.4 in CLEVRER. Set, like `POSITION_NOISE_WORLD`, `EDGE_NOISE_PX` and `ROBUST_SCALE`, on left-out scenes of `train`."""
POSITION_NOISE_WORLD = 0.01
"""Standard deviation of reliable positions (world units in CLEVRER)."""
EDGE_NOISE_PX = 2.0
"""Standard deviation of the left and right edges of boxes, which depend on the yaw (pixels)."""
ROBUST_SCALE = 2.0
"""Residuals beyond this many standard deviations are weighted down (soft L1)."""
LOG_MASS, PAIR_REBOUND = SPIN + 1, SPIN + 2
"""Kinds of parameters in addition to the columns of a state: the log mass of an object, and the rebound of a pair."""
NO_OBJECT = -1
"""Second object of a parameter that belongs to one object."""


class FitProblem(NamedTuple):
    """The measurements, and the meaning of each of the P parameters.

    Attributes:
        body: (n,) records of `BODY`.
        reference_s: (n,) times at which the parameters give the positions and velocities of the objects (s).
        position: (n, F, 2) measured positions (world units).
        root_weight: (n, F) square roots of the weights of the measurements; 0 where nothing was measured.
        edges_px: (n, F, 2) measured left and right edges of the boxes, which are fitted for boxes (pixels).
        parameters: (P, 3) int, the kind of each parameter (a column of the state, `LOG_MASS` or `PAIR_REBOUND`), its object,
            and for `PAIR_REBOUND` the other object, otherwise `NO_OBJECT`.
        unit: (P,) units of the parameters: a value is parameter · unit.
        prior: (P, 2) mean and standard deviation of the prior of each value; infinite for values without a prior.
        noise: standard deviation of reliable positions (world units).
        projection: rows of the projection, see `nsdr.dynamics.physics.cube_edges.projection_rows`.
    """

    body: NDArray[np.void]
    reference_s: NDArray[np.float64]
    position: NDArray[np.float64]
    root_weight: NDArray[np.float64]
    edges_px: NDArray[np.float64]
    parameters: NDArray[np.int64]
    unit: NDArray[np.float64]
    prior: NDArray[np.float64]
    noise: float
    projection: tuple[float, ...]


class Sums(NamedTuple):
    """Sums over the data of a run. The functions below change these arrays.

    Attributes:
        loss: (2,) sum of the robust losses, and number of residuals.
        gradient: (P,) gradient of the sum of the losses.
        curvature: (P, P) curvature of the sum of the losses.
        motion: (n, F, 6) states in every frame.
        next_frame: (n,) the first frame of each object whose data are not summed yet.
        outermost: (n, 2, 2) outermost outline points of each box in the last frame, see `box_edges_px`.
    """

    loss: NDArray[np.float64]
    gradient: NDArray[np.float64]
    curvature: NDArray[np.float64]
    motion: NDArray[np.float64]
    next_frame: NDArray[np.int64]
    outermost: NDArray[np.int64]


class _SegmentSums(NamedTuple):
    """Sums over the data of one segment. `_add_datum` changes these arrays.

    The pose is (x, y, yaw), on which the residuals of a datum depend.

    Attributes:
        gradient: (6,) gradient of the loss with respect to the state at the start of the segment.
        curvature: (6, 6) curvature of the loss with respect to that state.
        pose_gradient: (3,) gradient of the loss of one datum with respect to the pose.
        pose_curvature: (3, 3) curvature of the loss of one datum with respect to the pose.
        edge_derivatives: (2, 3) derivatives of the left and right edges with respect to the pose.
    """

    gradient: NDArray[np.float64]
    curvature: NDArray[np.float64]
    pose_gradient: NDArray[np.float64]
    pose_curvature: NDArray[np.float64]
    edge_derivatives: NDArray[np.float64]


@cached_njit
def rebounds(one, other):  # type: ignore[no-untyped-def]
    """`REBOUND` and `MAX_FITTED_REBOUND` of two bodies, as ratios of separation speed to approach speed."""
    restitution = pair_restitution(one, other)
    return REBOUND * restitution, min(MAX_FITTED_REBOUND * restitution, 1.0)


@cached_njit
def _soft_l1(residual):  # type: ignore[no-untyped-def]
    """Robust loss of a residual r, and its first and second derivative.

    ρ(r) = s² (√(1 + (r/s)²) - 1) with s = `ROBUST_SCALE`
    """
    root = np.sqrt(1 + (residual / ROBUST_SCALE) ** 2)
    return ROBUST_SCALE * ROBUST_SCALE * (root - 1), residual / root, 1 / (root * root * root)


@inlined_njit
def _add_datum(p, i, frame, state, derivatives, sums, segment):  # type: ignore[no-untyped-def]
    """Add the measurement of body i in a frame to the sums of a run and of a segment.

    With the pose q = (x, y, yaw) of the predicted `state` (6,), its `derivatives` (6, 6) with respect to the state s at the
    start of the segment, and r the residuals of the measured position and, for boxes, edges:

        gradient += (∂q/∂s)ᵀ Σ ρ'(r) ∂r/∂q
        curvature += (∂q/∂s)ᵀ (Σ ρ''(r) ∂r/∂q (∂r/∂q)ᵀ) ∂q/∂s
    """
    position, edges_px, root_weight, loss = (
        p.position[i, frame],
        p.edges_px[i, frame],
        p.root_weight[i, frame],
        sums.loss,
    )
    slope, bend, edge_derivatives = segment.pose_gradient, segment.pose_curvature, segment.edge_derivatives
    for a in range(3):
        slope[a] = bend[a, 0] = bend[a, 1] = bend[a, 2] = 0.0
    scale = root_weight / p.noise
    for k in range(2):
        value, first, second = _soft_l1((state[X + k] - position[k]) * scale)
        loss[0] += value
        slope[k] += first * scale
        bend[k, k] += second * scale * scale
    loss[1] += 2
    if p.body[i].is_box:
        scale = root_weight / EDGE_NOISE_PX
        edges = box_edges_px(
            p.projection, p.body[i], state[X], state[Y], state[YAW], sums.outermost[i], edge_derivatives
        )
        for side in range(2):
            value, first, second = _soft_l1((edges[side] - edges_px[side]) * scale)
            loss[0] += value
            for a in range(3):
                slope[a] += first * scale * edge_derivatives[side, a]
                for b in range(3):
                    bend[a, b] += second * scale * scale * edge_derivatives[side, a] * edge_derivatives[side, b]
        loss[1] += 2
    for a in range(STATE_SIZE):
        by_x, by_y, by_yaw = derivatives[X, a], derivatives[Y, a], derivatives[YAW, a]
        segment.gradient[a] += slope[0] * by_x + slope[1] * by_y + slope[2] * by_yaw
        bent_x = bend[0, 0] * by_x + bend[0, 1] * by_y + bend[0, 2] * by_yaw
        bent_y = bend[1, 0] * by_x + bend[1, 1] * by_y + bend[1, 2] * by_yaw
        bent_yaw = bend[2, 0] * by_x + bend[2, 1] * by_y + bend[2, 2] * by_yaw
        for b in range(STATE_SIZE):
            segment.curvature[a, b] += (
                bent_x * derivatives[X, b] + bent_y * derivatives[Y, b] + bent_yaw * derivatives[YAW, b]
            )


@inlined_njit
def _add_segment(sums, segment, sensitivity):  # type: ignore[no-untyped-def]
    """Add the sums of a segment to those of a run by the chain rule, with `sensitivity` (6, P) = ∂s/∂parameters.

    gradient += (∂s/∂parameters)ᵀ segment.gradient
    curvature += (∂s/∂parameters)ᵀ segment.curvature ∂s/∂parameters
    """
    bent = np.empty(STATE_SIZE)
    for a in range(len(sums.gradient)):
        for r in range(STATE_SIZE):
            sums.gradient[a] += segment.gradient[r] * sensitivity[r, a]
            bent[r] = 0.0
            for c in range(STATE_SIZE):
                bent[r] += segment.curvature[r, c] * sensitivity[c, a]
        for b in range(len(sums.gradient)):
            for r in range(STATE_SIZE):
                sums.curvature[a, b] += bent[r] * sensitivity[r, b]


@cached_njit
def _finish_segment(p, bodies, sums, i, seconds):  # type: ignore[no-untyped-def]
    """Sum the data in the segment of body i up to a time (s), and move the start of the segment to that time."""
    motion, root_weight = sums.motion[i], p.root_weight[i]
    body, state, start, spinning = bodies.body[i], bodies.state[i], bodies.start[i], bodies.end[i] < np.inf
    begin = end = sums.next_frame[i]
    while end < len(motion) and end * body.law.frame_seconds < seconds:
        end += 1
    derivatives = np.empty((end - begin + 1 if spinning else 1, STATE_SIZE, STATE_SIZE))
    if spinning:
        spin_derivatives(bodies, i, seconds, begin, derivatives)
    after = np.empty(STATE_SIZE)
    segment = _SegmentSums(
        np.zeros(STATE_SIZE), np.zeros((STATE_SIZE, STATE_SIZE)), np.empty(3), np.empty((3, 3)), np.empty((2, 3))
    )
    for k in range(begin, end + 1):
        when = k * body.law.frame_seconds if k < end else seconds
        here = derivatives[k - begin if spinning else 0]
        if spinning:
            state_at(bodies, i, when, after)
        else:
            slide_derivatives(body.law, state, when - start, after, here)
        if k == end:
            _add_segment(sums, segment, bodies.sensitivity[i])
            advance(bodies, i, seconds, after, here)
            break
        copy_state(after, motion[k])
        if root_weight[k] > 0:
            _add_datum(p, i, k, after, here, sums, segment)
    sums.next_frame[i] = end


@cached_njit
def _start(p, x, horizon):  # type: ignore[no-untyped-def]
    """The bodies that the parameters `x` (P,) describe, at their reference times, for a run up to the time `horizon` (s)."""
    bodies = new_bodies(p.body, len(x), int(horizon / p.body[0].step_seconds) + 1)
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
    """Apply the contact of bodies i and j, i < j. A pair that has already touched does not rebound again."""
    rebound, most = rebounds(p.body[i], p.body[j])
    by_parameter = np.zeros((3, len(x)))
    for k in range(len(x)):
        kind, one, other = p.parameters[k]
        if kind == LOG_MASS and one in (i, j):
            by_parameter[0 if one == i else 1, k] = bodies.mass[one] * p.unit[k]
        elif kind == PAIR_REBOUND and one == i and other == j:
            given = x[k] * p.unit[k]
            rebound = min(max(given, 0.0), most)
            by_parameter[2, k] = p.unit[k] if rebound == given else 0.0
    if touched:
        rebound, by_parameter[2] = 0.0, 0.0
    exchange(bodies, i, j, rebound, by_parameter)


@cached_njit
def _search(bodies, i, contacts, last_contact, when, since, horizon):  # type: ignore[no-untyped-def]
    """Write the time of the next contact of body i with each other body, from `since` on, to `when` (n, n) (s).

    Bodies that press on each other touch again and again. So the time without contact after a contact of a pair is one Bullet
    step longer after each of their contacts.
    """
    for k in range(len(bodies.start)):
        if k != i:
            a, b = min(i, k), max(i, k)
            ready = last_contact[a, b] + contacts[a, b] * bodies.body[a].step_seconds
            until = min(horizon, min(bodies.end[a], bodies.end[b]))
            when[a, b] = find_contact(bodies, a, b, max(since, ready), until)


@cached_njit
def _add_priors(p, x, sums):  # type: ignore[no-untyped-def]
    """Add the losses of the priors of the parameters `x` (P,) to the sums of a run."""
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
    """Time of the next event, and the two bodies concerned, which are the same one if its spin ends.

    Args:
        when: (n, n) times of the next contact of each pair (s).
        ends: (n,) times at which the spinning of each body ends (s).
    """
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
    """The mean robust loss of the residuals in the first `n_frames` frames, its derivatives, and the run.

    Args:
        p: the `FitProblem`.
        x: (P,) parameters.
        n_frames: number of frames of the run.

    Returns:
        The mean loss; its gradient (P,); its curvature (P, P); the states (n, n_frames, 6); and the frames of the first contact
        of each pair (n, n), or `NO_CONTACT`.
    """
    n, step_seconds, steps_per_frame = len(p.body), p.body[0].step_seconds, p.body[0].steps_per_frame
    horizon = (n_frames - 1) * p.body[0].law.frame_seconds
    bodies = _start(p, x, horizon)
    sums = Sums(
        np.zeros(2),
        np.zeros(len(x)),
        np.zeros((len(x), len(x))),
        np.empty((n, n_frames, STATE_SIZE)),
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
            now = horizon + step_seconds / 2
        for i in range(n):
            concerned[i] = last or i in (a, b)
            if concerned[i]:
                _finish_segment(p, bodies, sums, i, now)
        if last:
            break
        if a != b:
            _contact(p, bodies, x, a, b, contacts[a, b] > 0)
            if contacts[a, b] == 0:
                step = int(now / step_seconds) + 1
                first_contact[a, b] = first_contact[b, a] = int(step / steps_per_frame + 0.5)
            contacts[a, b] += 1
            last_contact[a, b] = now
        for i in range(n):
            if concerned[i]:
                start_segment(bodies, i, now, horizon)
    _add_priors(p, x, sums)
    loss, count = sums.loss
    return loss / count, sums.gradient / count, sums.curvature / count, sums.motion, first_contact
