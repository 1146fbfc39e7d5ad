"""The fit of the planar simulator to tracks: initial states, masses, yaws and rebounds with which one run explains the video.

The window of fitted frames grows by one collision at a time, so that each fit starts near its solution. Given rebounds make the
motion a smooth function of the initial state (see `simulator`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nsdr.dynamics.motion_states import COLLISION_MARGIN_FRAMES, REST_SPEED_WORLD_PER_S, MotionStates, detections_in
from nsdr.dynamics.physics.bodies import body_records
from nsdr.dynamics.physics.body_state import POSITION, VELOCITY, VX, VY, YAW, X, Y
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.cube_edges import drawn_edges_px, projection_rows
from nsdr.dynamics.physics.fit_objective import (
    LOG_MASS,
    MAX_FITTED_REBOUND,
    NO_OBJECT,
    PAIR_REBOUND,
    POSITION_NOISE_WORLD,
    REBOUND,
    FitProblem,
    evaluate,
)
from nsdr.dynamics.physics.simulator import BodyStates
from nsdr.dynamics.physics.solver import log_mass_covariance, minimise
from nsdr.dynamics.sliding import law_of, slide
from nsdr.dynamics.stretch import fit_stretch
from nsdr.types import Event
from nsdr.validation import FloatArray, IntArray
from nsdr.world.physics import DECIMALS

POSITION_UNIT, VELOCITY_UNIT, YAW_UNIT, REBOUND_UNIT = 0.01, 0.02, 0.1, 0.15
"""Units of parameters in the optimiser: typical changes (world units and world units/s in CLEVRER, radians). That of log masses
is the standard deviation of their prior."""
REBOUND_DEVIATION = 0.2
"""Standard deviation of the prior of a rebound. Set, like the other constants of this module, on left-out scenes of `train`."""
MAX_REBOUND = 1.015625
"""Largest rebound that a restart draws, as a multiple of the pair's coefficient of restitution: 0.65 in CLEVRER."""
MIN_WINDOW_FRAMES = 8
"""Length of the shortest window that is fitted (frames)."""
YAW_FRAMES = 8
"""The first guess of the yaw of a box is based on its edges up to this many frames after its reference frame."""
DEFAULT_YAW = 0.4
"""First guess of the yaw of a box without reliable edges (radians)."""
MIN_MOVING_FRAMES = 3
"""The first detections of an object must span this many frames to show that it moves."""
MIN_SPEED_WORLD_PER_S = 0.2
"""An object that is slower before its first collision is treated as at rest (world units/s in CLEVRER)."""
EVALUATIONS = 25
"""Largest number of evaluations of the objective for a window."""
YAW_GUESSES = 12
"""Number of yaws that are compared in a quarter turn for the first guess of a box's yaw. Boxes with unequal sides are the same
only after half a turn."""
GOOD_COST = 0.4
"""A fit with a lower cost is not restarted. At this cost, a fit counts as explaining half of the video."""
RESTART_YAW_NOISE_PX = 0.7
"""Mean of the exponential noise that a restart adds to the edge error of each yaw before it picks the best (pixels)."""
RESTART_LOG_MASS_SCALE = 0.7
"""Standard deviation of the noise that a restart adds to a log mass, in its unit; it is 1 for other parameters."""


@dataclass(frozen=True)
class TrajectoryFit:
    """One run of the simulator that explains a video.

    Attributes:
        bodies: the objects in frame 0.
        rebound: (n, n) fitted rebounds; NaN for pairs that were not expected to collide.
        states: (n, F, 6) states in every frame of the run.
        contact: (n, n) int, the frame of the first contact of each pair in the run, or `NO_CONTACT`.
        cost: mean robust loss of the residuals.
        log_mass_covariance: (n, n) covariance of the errors of the log masses; see `solver`.
    """

    bodies: BodyStates
    rebound: FloatArray
    states: FloatArray
    contact: IntArray
    cost: float
    log_mass_covariance: FloatArray


def fit_trajectories(
    states: MotionStates,
    collisions: Sequence[Event],
    restarts: int = PhysicsConfig.restarts,
    start: TrajectoryFit | None = None,
) -> TrajectoryFit:
    """Fit one run of the simulator to the tracks of a video.

    Args:
        states: motion states of at least one object.
        collisions: collisions during the video, in order of time.
        restarts: largest number of restarts for each window.
        start: a fit of the same tracks with other collisions, from which this fit starts; None for a first guess.
    """
    problem = _Problem(states, collisions, restarts)
    if start is not None:
        return problem.result(problem.solve_with_restarts(problem.parameters(start), problem.frames))
    frames = [*sorted({e.frame for e in collisions}), states.present.shape[1]]
    x = problem.start()
    for end in frames:
        window = min(max(end - COLLISION_MARGIN_FRAMES, MIN_WINDOW_FRAMES), problem.frames)
        x = problem.solve_with_restarts(x, window)
    return problem.result(x)


class _Problem:
    """The fit of one video: first guesses of its parameters, their optimisation, and conversion to runs."""

    def __init__(
        self, states: MotionStates, collisions: Sequence[Event], restarts: int = PhysicsConfig.restarts
    ) -> None:
        self.states, self.collisions, self.restarts = states, collisions, restarts
        self.rng = np.random.default_rng(0)
        n, self.frames = states.present.shape
        world, scales = states.world, states.world.scales
        self.frame_seconds, self.log_mass_std = world.physics.frame_seconds, world.physics.log_mass_std
        self.body = body_records(states.objects, world)
        self.restitution = np.round(np.outer(self.body["restitution"], self.body["restitution"]), DECIMALS)
        self.min_speed, self.rest_speed = MIN_SPEED_WORLD_PER_S * scales.speed, REST_SPEED_WORLD_PER_S * scales.speed
        self.reference = np.zeros(n)
        self.first = np.zeros((n, LOG_MASS + 1))  # states and log masses
        rows: list[tuple[int, ...]] = []
        for i in range(n):
            moving = self._first_stretch(i)
            collides = any(i in e.objects for e in collisions)
            is_used = {X: True, Y: True, VX: moving, VY: moving, LOG_MASS: collides, YAW: bool(self.body[i]["is_box"])}
            rows += [(kind, i, NO_OBJECT) for kind, used in is_used.items() if used]
        rows += [(PAIR_REBOUND, *pair) for pair in dict.fromkeys(e.objects for e in collisions)]
        parameters = np.array(rows)
        units = dict.fromkeys((X, Y), POSITION_UNIT * scales.size) | dict.fromkeys(
            (VX, VY), VELOCITY_UNIT * scales.speed
        )
        units |= {YAW: YAW_UNIT, LOG_MASS: self.log_mass_std, PAIR_REBOUND: REBOUND_UNIT}
        self.unit = np.array([units[kind] for kind, _, _ in parameters.tolist()])
        prior = np.full((len(rows), 2), np.inf)
        prior[parameters[:, 0] == LOG_MASS] = 0.0, self.log_mass_std
        for k in np.flatnonzero(parameters[:, 0] == PAIR_REBOUND):
            prior[k] = REBOUND * self.restitution[tuple(parameters[k, 1:])], REBOUND_DEVIATION
        self.problem = FitProblem(
            self.body,
            self.reference * self.frame_seconds,
            np.ascontiguousarray(states.location_world, float),
            np.sqrt(states.weight),
            np.ascontiguousarray(states.box_xyxy_px[..., ::2]),
            parameters,
            self.unit,
            prior,
            POSITION_NOISE_WORLD * scales.size,
            projection_rows(states.camera),
        )

    def _first_stretch(self, i: int) -> bool:
        """Set the reference frame of object i and its position and velocity there. Returns whether it moves."""
        states, weight, seen = self.states, self.states.weight[i], np.flatnonzero(self.states.detected[i])
        hits = [e.frame for e in self.collisions if i in e.objects]
        mine = seen[seen < min(hits) - COLLISION_MARGIN_FRAMES] if hits else seen
        least = detections_in(MIN_MOVING_FRAMES, states.spacing_frames)
        if len(mine) < 2:
            mine = seen[:least]
        reference = float(np.round(np.average(mine, weights=weight[mine])))
        stretch = fit_stretch(
            law_of(states.objects[i], states.world), mine, states.location_world[i, mine], weight[mine]
        )
        begin, velocity = stretch.velocity_at(np.array([0.0, reference]))
        position, speed = stretch.position_at(np.array([reference]))[0], np.hypot(*velocity)
        fast = bool(np.hypot(*begin) > self.rest_speed and speed > self.min_speed)
        if len(mine) >= least and fast:
            self.reference[i], self.first[i, VELOCITY] = reference, velocity
        else:
            position = np.average(states.location_world[i, mine], axis=0, weights=weight[mine])
            fast = False
        self.first[i, POSITION] = position
        return fast

    def start(self) -> FloatArray:
        """First guess of the parameters (P,): motion before the first collisions, equal masses, and yaws that fit the edges."""
        rows = self.first.copy()
        rows[:, YAW] = [self._first_yaw(i) if is_box else 0.0 for i, is_box in enumerate(self.body["is_box"])]
        return self._values(rows, REBOUND * self.restitution)

    def parameters(self, fit: TrajectoryFit) -> FloatArray:
        """The parameters (P,) that correspond to a fit with other collisions."""
        rows = np.column_stack([fit.bodies.state, np.log(fit.bodies.mass)])
        for row, o, reference in zip(rows, self.states.objects, self.reference, strict=True):
            speed = float(np.hypot(*row[VELOCITY]))
            direction = row[VELOCITY] / max(speed, 1e-9)
            distance, later = slide(
                law_of(o, self.states.world), np.array(speed), np.array(reference * self.frame_seconds)
            )
            row[POSITION] += float(distance) * direction
            row[VELOCITY] = float(later) * direction
        return self._values(rows, np.where(np.isnan(fit.rebound), REBOUND * self.restitution, fit.rebound))

    def _values(self, rows: FloatArray, rebound: FloatArray) -> FloatArray:
        """The parameters (P,) for the states and log masses of objects (n, 7) and the rebounds of pairs (n, n)."""
        values = [rebound[i, j] if kind == PAIR_REBOUND else rows[i, kind] for kind, i, j in self.problem.parameters]
        return np.array(values) / self.unit

    def _first_yaw(self, i: int, rng: np.random.Generator | None = None) -> float:
        """The yaw of box i whose edges fit best in its first frames (radians).

        With `rng`, the yaw is drawn at random; yaws that fit better are more probable.
        """
        near = np.flatnonzero(self.states.reliable[i])
        near = near[near <= self.reference[i] + YAW_FRAMES]
        if not len(near):
            return DEFAULT_YAW
        box, (x, y) = self.body[i], self.body[i]["half"]
        guesses = np.pi / 2 * np.arange(YAW_GUESSES if x == y else 2 * YAW_GUESSES) / YAW_GUESSES
        p = self.problem
        drawn = drawn_edges_px(p.projection, box, p.position[i, near], guesses)
        errors = [np.abs(p.edges_px[i, near] - edges).mean() for edges in drawn]
        noise = 0.0 if rng is None else rng.exponential(RESTART_YAW_NOISE_PX, len(errors))
        return float(guesses[int(np.argmin(np.array(errors) + noise))])

    def solve_with_restarts(self, x: FloatArray, n_frames: int) -> FloatArray:
        """The best parameters (P,) for the first `n_frames` frames; restarts are tried while the cost is high."""
        best, cost = minimise(self.problem, x, n_frames, EVALUATIONS)
        met = [e for e in self.collisions if e.frame < n_frames]
        concerned = {i for e in met[-2:] for i in e.objects}
        for _ in range(self.restarts if met else 0):
            if cost < GOOD_COST:
                break
            start = best.copy()
            for k, (kind, i, j) in enumerate(self.problem.parameters.tolist()):
                if kind == PAIR_REBOUND and any(e.objects == (i, j) for e in met[-2:]):
                    start[k] = self.rng.uniform(0, MAX_REBOUND * self.restitution[i, j]) / self.unit[k]
                elif kind == YAW and i in concerned:
                    start[k] = self._first_yaw(i, self.rng) / self.unit[k]
                elif i in concerned and kind != PAIR_REBOUND:
                    start[k] += self.rng.normal() * (RESTART_LOG_MASS_SCALE if kind == LOG_MASS else 1.0)
            trial, trial_cost = minimise(self.problem, start, n_frames, EVALUATIONS)
            if trial_cost < cost:
                best, cost = trial, trial_cost
        return np.asarray(best)

    def result(self, x: FloatArray) -> TrajectoryFit:
        """The run with parameters `x` (P,)."""
        cost, _, curvature, states, contact = evaluate(self.problem, x, self.frames)
        n = len(self.body)
        mass, rebound = np.ones(n), np.full((n, n), np.nan)
        most = np.minimum(MAX_FITTED_REBOUND * self.restitution, 1.0)
        for value, (kind, i, j) in zip(x * self.unit, self.problem.parameters, strict=True):
            if kind == LOG_MASS:
                mass[i] = np.exp(value)
            elif kind == PAIR_REBOUND:
                rebound[i, j] = rebound[j, i] = min(max(value, 0.0), most[i, j])
        covariance = log_mass_covariance(self.problem, curvature, float(cost), self.log_mass_std)
        return TrajectoryFit(
            BodyStates(self.body, states[:, 0], mass), rebound, states, contact, float(cost), covariance
        )
