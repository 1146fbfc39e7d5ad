"""The fit of the planar simulator to tracks: initial states, masses, yaws and rebounds with which one run explains the video.

The window of fitted frames grows by one collision at a time, so that each fit starts near its solution. Given rebounds make the
motion a smooth function of the initial state (see `simulator`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nsdr.dynamics.motion_states import COLLISION_MARGIN_FRAMES, REST_SPEED_WORLD_PER_S, MotionStates, detections_in
from nsdr.dynamics.physics.body_state import POSITION, VELOCITY, VX, VY, YAW, X, Y
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.physics.contact_geometry import CUBE
from nsdr.dynamics.physics.cube_edges import cube_edges_px, projection_rows
from nsdr.dynamics.physics.fit_objective import (
    LOG_MASS,
    MAX_FITTED_REBOUND,
    NO_OBJECT,
    PAIR_REBOUND,
    REBOUND,
    FitProblem,
    evaluate,
)
from nsdr.dynamics.physics.simulator import BodyStates
from nsdr.dynamics.physics.solver import log_mass_covariance, minimise
from nsdr.dynamics.sliding import slide
from nsdr.dynamics.stretch import fit_stretch
from nsdr.types import Event
from nsdr.validation import FloatArray, IntArray
from nsdr.world.physics_constants import FRAME_SECONDS, LOG_MASS_STD
from nsdr.world.vocabulary import SHAPES

UNITS = {X: 0.01, Y: 0.01, VX: 0.02, VY: 0.02, YAW: 0.1, LOG_MASS: LOG_MASS_STD, PAIR_REBOUND: 0.15}
"""Unit of each kind of parameter in the optimiser: a typical change (world units, world units/s, radians)."""
REBOUND_DEVIATION = 0.2
"""Standard deviation of the prior of a rebound. Set, like the other constants of this module, on left-out scenes of `train`."""
MAX_REBOUND = 0.65
"""Largest rebound that a restart draws (Bullet's coefficient of restitution is 0.64)."""
MIN_WINDOW_FRAMES = 8
"""Length of the shortest window that is fitted (frames)."""
YAW_FRAMES = 8
"""The first guess of the yaw of a cube is based on its edges up to this many frames after its reference frame."""
DEFAULT_YAW = 0.4
"""First guess of the yaw of a cube without reliable edges (radians)."""
MIN_MOVING_FRAMES = 3
"""The first detections of an object must span this many frames to show that it moves."""
MIN_SPEED_WORLD_PER_S = 0.2
"""An object that is slower before its first collision is treated as at rest (world units/s)."""
EVALUATIONS = 25
"""Largest number of evaluations of the objective for a window."""
YAW_GUESSES = 12
"""Number of yaws that are compared for the first guess of a cube's yaw, spread over a quarter turn."""
GOOD_COST = 0.4
"""A fit with a lower cost is not restarted. At this cost, a fit counts as explaining half of the video."""
RESTART_YAW_NOISE_PX = 0.7
"""Mean of the exponential noise that a restart adds to the edge error of each yaw before it picks the best (pixels)."""
RESTART_LOG_MASS_SCALE = 0.7
"""Standard deviation of the noise that a restart adds to a log mass, in its unit in `UNITS`; it is 1 for other parameters."""


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
        self.shape = np.array([SHAPES.index(o.shape) for o in states.objects])
        self.reference = np.zeros(n)
        self.first = np.zeros((n, LOG_MASS + 1))  # states and log masses
        rows: list[tuple[int, ...]] = []
        for i in range(n):
            moving = self._first_stretch(i)
            collides = any(i in e.objects for e in collisions)
            is_used = {X: True, Y: True, VX: moving, VY: moving, LOG_MASS: collides, YAW: self.shape[i] == CUBE}
            rows += [(kind, i, NO_OBJECT) for kind, used in is_used.items() if used]
        rows += [(PAIR_REBOUND, *pair) for pair in dict.fromkeys(e.objects for e in collisions)]
        parameters = np.array(rows)
        self.unit = np.array([UNITS[kind] for kind, _, _ in parameters.tolist()])
        prior = np.full((len(rows), 2), np.inf)
        prior[parameters[:, 0] == LOG_MASS] = 0.0, LOG_MASS_STD
        prior[parameters[:, 0] == PAIR_REBOUND] = REBOUND, REBOUND_DEVIATION
        self.problem = FitProblem(
            self.shape,
            self.reference * FRAME_SECONDS,
            np.ascontiguousarray(states.location_world, float),
            np.sqrt(states.weight),
            np.ascontiguousarray(states.box_xyxy_px[..., ::2]),
            parameters,
            self.unit,
            prior,
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
        stretch = fit_stretch(states.objects[i].shape, mine, states.location_world[i, mine], weight[mine])
        begin, velocity = stretch.velocity_at(np.array([0.0, reference]))
        position, speed = stretch.position_at(np.array([reference]))[0], np.hypot(*velocity)
        fast = bool(np.hypot(*begin) > REST_SPEED_WORLD_PER_S and speed > MIN_SPEED_WORLD_PER_S)
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
        rows[:, YAW] = [self._first_yaw(i) if shape == CUBE else 0.0 for i, shape in enumerate(self.shape)]
        return self._values(rows, np.full((len(rows), len(rows)), REBOUND))

    def parameters(self, fit: TrajectoryFit) -> FloatArray:
        """The parameters (P,) that correspond to a fit with other collisions."""
        rows = np.column_stack([fit.bodies.state, np.log(fit.bodies.mass)])
        for row, o, reference in zip(rows, self.states.objects, self.reference, strict=True):
            speed = float(np.hypot(*row[VELOCITY]))
            direction = row[VELOCITY] / max(speed, 1e-9)
            distance, later = slide(o.shape, np.array(speed), np.array(reference * FRAME_SECONDS))
            row[POSITION] += float(distance) * direction
            row[VELOCITY] = float(later) * direction
        return self._values(rows, np.where(np.isnan(fit.rebound), REBOUND, fit.rebound))

    def _values(self, rows: FloatArray, rebound: FloatArray) -> FloatArray:
        """The parameters (P,) for the states and log masses of objects (n, 7) and the rebounds of pairs (n, n)."""
        values = [rebound[i, j] if kind == PAIR_REBOUND else rows[i, kind] for kind, i, j in self.problem.parameters]
        return np.array(values) / self.unit

    def _first_yaw(self, i: int, rng: np.random.Generator | None = None) -> float:
        """The yaw of cube i whose edges fit best in its first frames (radians).

        With `rng`, the yaw is drawn at random; yaws that fit better are more probable.
        """
        near = np.flatnonzero(self.states.reliable[i])
        near = near[near <= self.reference[i] + YAW_FRAMES]
        if not len(near):
            return DEFAULT_YAW
        guesses = np.pi / 2 * np.arange(YAW_GUESSES) / YAW_GUESSES
        p, outermost, derivatives = self.problem, np.zeros((2, 2), np.int64), np.empty((2, 3))
        errors = []
        for yaw in guesses:
            drawn = [cube_edges_px(p.projection, *xy, yaw, outermost, derivatives) for xy in p.position[i, near]]
            errors.append(np.abs(p.edges_px[i, near] - drawn).mean())
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
                    start[k] = self.rng.uniform(0, MAX_REBOUND) / self.unit[k]
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
        n = len(self.shape)
        mass, rebound = np.ones(n), np.full((n, n), np.nan)
        for value, (kind, i, j) in zip(x * self.unit, self.problem.parameters, strict=True):
            if kind == LOG_MASS:
                mass[i] = np.exp(value)
            elif kind == PAIR_REBOUND:
                rebound[i, j] = rebound[j, i] = min(max(value, 0.0), MAX_FITTED_REBOUND)
        covariance = log_mass_covariance(self.problem, curvature, float(cost))
        return TrajectoryFit(
            BodyStates(self.shape, states[:, 0], mass), rebound, states, contact, float(cost), covariance
        )
