"""Fitting the planar simulator to tracks: initial states, masses, yaws and rebounds, so that one run explains the video.

The window of frames grows by one collision at a time, so that each fit starts near its solution; given rebounds make the
motion a smooth function of the initial state (see `simulator`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.motion_states import (
    COLLISION_MARGIN_FRAMES,
    REST_SPEED_WORLD_PER_S,
    UNRELIABLE_WEIGHT,
    MotionStates,
    detections_in,
)
from nsdr.dynamics.physics.contact_geometry import CUBE
from nsdr.dynamics.physics.fit_objective import (
    MAX_FITTED_REBOUND,
    REBOUND,
    FitProblem,
    cube_edges_px,
    evaluate,
    rows_of,
)
from nsdr.dynamics.physics.simulator import BodyStates, SimulatedMotion
from nsdr.dynamics.physics.solver import log_mass_covariance, minimise
from nsdr.dynamics.sliding import fit_sliding, slide
from nsdr.types import Event
from nsdr.world.physics_constants import FRAME_SECONDS, LOG_MASS_STD
from nsdr.world.vocabulary import SHAPES

__all__ = ["GOOD_COST", "TrajectoryFit", "fit_trajectories"]

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
UNITS = {"position": 0.01, "velocity": 0.02, "log_mass": LOG_MASS_STD, "yaw": 0.1, "rebound": 0.15}
"""Typical change of each kind of parameter; the optimiser works in these units."""
REBOUND_DEVIATION = 0.2
"""Prior standard deviation of a rebound. Like the others here, set on left-out scenes of `train`."""
MAX_REBOUND = 0.65
"""Largest first guess of a rebound (Bullet's restitution is 0.64)."""
MAX_LOG_MASS = 0.4
"""Range of first guesses of a log mass; log(1.3) is 0.26."""
MIN_APPROACH_SPEED, MIN_SPEED_CHANGE = 0.3, 0.1
"""Collisions with a slower approach, or a smaller change of velocity, say nothing about masses (world units/s)."""
MASS_RATIO_WEIGHT = 3.0
"""Weight of a mass ratio measured from one collision, relative to the prior."""
MIN_WINDOW_FRAMES = 8
"""Shortest window that is fitted (frames)."""
YAW_FRAMES = 8
"""Frames after an object's reference frame whose edges give the first guess of its yaw."""
DEFAULT_YAW = 0.4
"""First guess of the yaw (radians) of a cube without reliable edges."""
MIN_STRETCH_FRAMES = 4
"""Frames over which detections must reach on each side of a collision to measure velocities there."""
MIN_MOVING_FRAMES = 3
"""Frames over which an object's first detections must reach to show that it moves."""
MIN_SPEED_WORLD_PER_S = 0.2
"""Objects slower than this when seen before their first collision are treated as at rest (world units/s)."""
EVALUATIONS = 25
"""Largest number of evaluations of the optimiser for a window."""
YAW_GUESSES = 12
"""First guesses of a cube's yaw, over a quarter turn."""
GOOD_COST = 0.4
"""Fits with at most this cost are not restarted: they explain a video at least half."""
RESTARTS = 6
"""Restarts for a window, unless told otherwise."""
RESTART_YAW_NOISE_PX = 0.7
"""Mean of the exponential noise on a yaw's edge error when a restart draws it (pixels)."""
RESTART_LOG_MASS_SCALE = 0.7
"""Standard deviation of restarts' log masses, in `UNITS`; other parameters have 1."""
_NEVER = 10**6


@dataclass(frozen=True)
class TrajectoryFit:
    """One run of the simulator that explains a video.

    Attributes:
        bodies: the objects at frame 0.
        rebound: (n, n) fitted rebounds, NaN for pairs that were not expected to collide.
        motion: the run over the video.
        error_world: (n,) median distance from each object's reliable positions; NaN without any.
        cost: half the sum of squared, robust residuals for each datum.
        log_mass_covariance: (n, n) covariance of the log masses' errors; see `solver`.
    """

    bodies: BodyStates
    rebound: FloatArray
    motion: SimulatedMotion
    error_world: FloatArray
    cost: float
    log_mass_covariance: FloatArray


def fit_trajectories(
    states: MotionStates,
    collisions: Sequence[Event],
    restarts: int = RESTARTS,
    start: TrajectoryFit | None = None,
) -> TrajectoryFit:
    """Fit one run to a video's tracks.

    Args:
        states: of at least one object.
        collisions: during the video, in order of time.
        restarts: largest number of restarts for a window.
        start: fit of the same tracks from which this one starts; None for a first guess.
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


@dataclass(frozen=True)
class _Data:
    """What was measured of one object."""

    frame: IntArray
    position: FloatArray
    weight: FloatArray
    edges_px: FloatArray | None
    """(T, 2) left and right of the box, of cubes."""


class _Problem:
    """Parameters <-> runs, and the residuals of a run."""

    def __init__(self, states: MotionStates, collisions: Sequence[Event], restarts: int = RESTARTS) -> None:
        self.restarts = restarts
        self.rng = np.random.default_rng(0)
        self.objects, self.projection = states.objects, rows_of(states.camera)
        self.collisions = collisions
        self.shape = np.array([SHAPES.index(o.shape) for o in states.objects])
        self.frames, self.spacing_frames = states.present.shape[1], states.spacing_frames
        self.data = [self._measured(states, i) for i in range(len(self.objects))]
        self.reference = np.zeros(len(self.objects))
        self.moving = np.zeros(len(self.objects), bool)
        self.first: list[tuple[FloatArray, FloatArray]] = []
        for i, d in enumerate(self.data):
            self.first.append(self._first_stretch(i, d))
        self.names = self._names()
        self.unit = np.array([UNITS[kind] for kind, *_ in self.names])
        self.problem = self._compiled()

    def _measured(self, states: MotionStates, i: int) -> _Data:
        frame = np.flatnonzero(states.detected[i])
        weight = np.where(states.reliable[i, frame], 1.0, UNRELIABLE_WEIGHT)
        middle, width = states.box_px[i, frame, 0], states.box_px[i, frame, 2]
        edges = np.stack([middle - width / 2, middle + width / 2], 1) if self.shape[i] == CUBE else None
        return _Data(frame, states.location_world[i, frame], weight, edges)

    def _first_stretch(self, i: int, d: _Data) -> tuple[FloatArray, FloatArray]:
        """Position and velocity at a frame of the first stretch; sets `reference` and `moving`."""
        hits = [e.frame for e in self.collisions if i in e.objects]
        end = min(hits) - COLLISION_MARGIN_FRAMES if hits else _NEVER
        mine = d.frame < end
        if mine.sum() < 2:
            mine = np.arange(len(d.frame)) < detections_in(MIN_MOVING_FRAMES, self.spacing_frames)
        self.reference[i] = float(np.round(np.average(d.frame[mine], weights=d.weight[mine])))
        shape = self.objects[i].shape
        position, velocity, _ = fit_sliding(shape, d.frame[mine], d.position[mine], d.weight[mine], self.reference[i])
        begin = slide(shape, np.hypot(*velocity), np.array(-self.reference[i] * FRAME_SECONDS))[1]
        speed = float(np.hypot(*velocity))
        fast = float(begin) > REST_SPEED_WORLD_PER_S and speed > MIN_SPEED_WORLD_PER_S
        self.moving[i] = mine.sum() >= detections_in(MIN_MOVING_FRAMES, self.spacing_frames) and fast
        if not self.moving[i]:
            self.reference[i] = 0.0
            position = np.average(d.position[mine], axis=0, weights=d.weight[mine])
        return position, velocity

    def _names(self) -> list[tuple[str, int, int]]:
        names = []
        for i in range(len(self.objects)):
            names += [("position", i, 0), ("position", i, 1)]
            if self.moving[i]:
                names += [("velocity", i, 0), ("velocity", i, 1)]
            if any(i in e.objects for e in self.collisions):
                names.append(("log_mass", i, 0))
            if self.shape[i] == CUBE:
                names.append(("yaw", i, 0))
        return names + [("rebound", e.objects[0], e.objects[1]) for e in self.collisions]

    def start(self) -> FloatArray:
        """First guess: stretches before the first collisions, velocities around each, and cubes' turns by their edges."""
        position, velocity = np.array([f[0] for f in self.first]), np.array([f[1] for f in self.first])
        yaw = np.array([self._first_yaw(i) if shape == CUBE else 0.0 for i, shape in enumerate(self.shape)])
        return self._values(position, velocity, yaw, *self._exchanges())

    def parameters(self, fit: TrajectoryFit) -> FloatArray:
        """Those of a fit with other collisions."""
        position, velocity = fit.bodies.position.copy(), np.zeros_like(fit.bodies.velocity)
        for i, o in enumerate(self.objects):
            speed = float(np.hypot(*fit.bodies.velocity[i]))
            direction = fit.bodies.velocity[i] / max(speed, 1e-9)
            distance, later = slide(o.shape, np.array(speed), np.array(self.reference[i] * FRAME_SECONDS))
            position[i] += float(distance) * direction
            velocity[i] = float(later) * direction
        rebound = np.where(np.isnan(fit.rebound), REBOUND, fit.rebound)
        return self._values(position, velocity, fit.bodies.yaw, np.log(fit.bodies.mass), rebound)

    def _values(
        self, position: FloatArray, velocity: FloatArray, yaw: FloatArray, log_mass: FloatArray, rebound: FloatArray
    ) -> FloatArray:
        """Parameters (P,) of what is known of the objects (n, …) and pairs (n, n)."""
        of = {"position": position, "velocity": velocity, "rebound": rebound}
        of |= {"yaw": yaw[:, None], "log_mass": log_mass[:, None]}
        return np.array([of[kind][i, k] for kind, i, k in self.names], float) / self.unit

    def _exchanges(self) -> tuple[FloatArray, FloatArray]:
        """Log masses and rebounds by the velocities before and after each collision."""
        n = len(self.objects)
        rows, values, rebound = [np.eye(n)], [np.zeros(n)], np.full((n, n), REBOUND)
        for e in self.collisions:
            stretches = [f for f in (self._around(i, e.frame) for i in e.objects) if f is not None]
            if len(stretches) < 2:
                continue
            (position_i, before_i, after_i), (position_j, before_j, after_j) = stretches
            normal = (position_j - position_i) / max(float(np.linalg.norm(position_j - position_i)), 1e-6)
            change_i, change_j = np.linalg.norm(after_i - before_i), np.linalg.norm(after_j - before_j)
            approach, parting = (before_i - before_j) @ normal, (after_j - after_i) @ normal
            if approach > MIN_APPROACH_SPEED and min(change_i, change_j) > MIN_SPEED_CHANGE:
                rebound[e.objects] = float(np.clip(parting / approach, 0.0, MAX_REBOUND))
                row = np.zeros((1, n))
                row[0, list(e.objects)] = (1, -1)
                rows.append(MASS_RATIO_WEIGHT * row)
                values.append(np.array([MASS_RATIO_WEIGHT * np.log(change_j / change_i)]))
        log_mass = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
        return np.clip(log_mass, -MAX_LOG_MASS, MAX_LOG_MASS), rebound

    def _around(self, i: int, frame: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Position of an object at a collision, and its velocity before and after; None where it was seen too little."""
        hits = [e.frame for e in self.collisions if i in e.objects]
        start = max([f for f in hits if f < frame], default=-_NEVER)
        end = min([f for f in hits if f > frame], default=_NEVER)
        found, d, margin = [], self.data[i], COLLISION_MARGIN_FRAMES
        for low, high in ((start + margin, frame - margin), (frame + margin, end - margin)):
            mine = (d.frame >= low) & (d.frame <= high)
            if mine.sum() < detections_in(MIN_STRETCH_FRAMES, self.spacing_frames):
                return None
            found.append(fit_sliding(self.objects[i].shape, d.frame[mine], d.position[mine], d.weight[mine], frame))
        return found[0][0], found[0][1], found[1][1]

    def _first_yaw(self, i: int, rng: np.random.Generator | None = None) -> float:
        """The turn whose edges fit best at first, or with `rng` any, the better the likelier."""
        d = self.data[i]
        near = (d.frame <= self.reference[i] + YAW_FRAMES) & (d.weight == 1)
        if not near.any():
            return DEFAULT_YAW
        guesses = np.pi / 2 * np.arange(YAW_GUESSES) / YAW_GUESSES
        assert d.edges_px is not None
        errors = [
            np.abs(d.edges_px[near] - _edges_px(self.projection, d.position[near], yaw)).mean() for yaw in guesses
        ]
        noise = 0.0 if rng is None else rng.exponential(RESTART_YAW_NOISE_PX, len(errors))
        return float(guesses[int(np.argmin(np.array(errors) + noise))])

    def solve_with_restarts(self, x: FloatArray, n_frames: int) -> FloatArray:
        """The best of several solutions: other starts are tried while the cost is high."""
        best, cost = minimise(self.problem, x, n_frames, EVALUATIONS)
        met = [e for e in self.collisions if e.frame < n_frames]
        concerned = {i for e in met[-2:] for i in e.objects}
        for _ in range(self.restarts if met else 0):
            if cost < GOOD_COST:
                break
            start = best.copy()
            for k, (kind, i, j) in enumerate(self.names):
                if kind == "rebound" and any(e.objects == (i, j) for e in met[-2:]):
                    start[k] = self.rng.uniform(0, MAX_REBOUND) / self.unit[k]
                elif kind == "yaw" and i in concerned:
                    start[k] = self._first_yaw(i, self.rng) / self.unit[k]
                elif i in concerned and kind in ("position", "velocity", "log_mass"):
                    start[k] += self.rng.normal() * (RESTART_LOG_MASS_SCALE if kind == "log_mass" else 1.0)
            trial, trial_cost = minimise(self.problem, start, n_frames, EVALUATIONS)
            if trial_cost < cost:
                best, cost = trial, trial_cost
        return np.asarray(best)

    def result(self, x: FloatArray) -> TrajectoryFit:
        cost, _, curvature, states, contact = evaluate(self.problem, x, self.frames)
        n = len(self.objects)
        position, velocity = states[..., :2], states[..., 2:4]
        mass, rebound = np.ones(n), np.full((n, n), np.nan)
        for value, (kind, i, j) in zip(x * self.unit, self.names, strict=True):
            if kind == "log_mass":
                mass[i] = np.exp(value)
            elif kind == "rebound":
                rebound[i, j] = rebound[j, i] = min(max(value, 0.0), MAX_FITTED_REBOUND)
        bodies = BodyStates(self.shape, position[:, 0], velocity[:, 0], states[:, 0, 4], states[:, 0, 5], mass)
        motion = SimulatedMotion(position, velocity, states[..., 4], states[..., 5], contact, np.zeros(n, np.int64))
        errors = []
        for i, d in enumerate(self.data):
            good = d.weight == 1
            distance = np.linalg.norm(position[i, d.frame[good]] - d.position[good], axis=1)
            errors.append(float(np.median(distance)) if good.any() else float("nan"))
        covariance = log_mass_covariance(self.problem, self.names, curvature, float(cost))
        return TrajectoryFit(bodies, rebound, motion, np.array(errors), float(cost), covariance)

    def _compiled(self) -> FitProblem:
        """The same for the compiled objective."""
        n = len(self.objects)
        at = {kind: np.full(n, -1) for kind in ("position", "velocity", "log_mass", "yaw")}
        rebound_at, prior = np.full((n, n), -1), np.full((len(self.names), 2), np.inf)
        for k, (kind, i, j) in enumerate(self.names):
            if kind == "rebound":
                rebound_at[i, j] = rebound_at[j, i] = k
                prior[k] = (REBOUND, REBOUND_DEVIATION)
            elif j == 0:
                at[kind][i] = k
            if kind == "log_mass":
                prior[k] = (0.0, LOG_MASS_STD)
        edges = [np.full((len(d.frame), 2), np.nan) if d.edges_px is None else d.edges_px for d in self.data]
        return FitProblem(
            self.shape,
            self.reference * FRAME_SECONDS,
            np.cumsum([0, *(len(d.frame) for d in self.data)]),
            np.concatenate([d.frame for d in self.data]),
            np.concatenate([d.position for d in self.data]),
            np.sqrt(np.concatenate([d.weight for d in self.data])),
            np.concatenate(edges),
            self.unit,
            at["position"],
            at["velocity"],
            at["log_mass"],
            at["yaw"],
            rebound_at,
            prior,
            self.projection,
        )


def _edges_px(projection: tuple[float, ...], position: FloatArray, yaw: float) -> FloatArray:
    """(T, 2) left and right edges of a cube's images at positions (T, 2)."""
    outermost, derivatives = np.zeros((2, 2), np.int64), np.empty((2, 3))
    return np.array([cube_edges_px(projection, x, y, yaw, outermost, derivatives) for x, y in position])
