"""Fitting the planar simulator to tracks: every object's start, mass, turn and rebounds, so that one run explains the video.

The window of frames grows by one collision at a time, so that each fit starts near its solution; given rebounds make the
motion a smooth function of the start (see `planar`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares

from nsdr.clevrer.camera import CAMERA_MATRIX, FRAME_SECONDS, OBJECT_RADIUS_WORLD
from nsdr.clevrer.vocab import SHAPES
from nsdr.dynamics.flight import fit_flight, fly
from nsdr.dynamics.outlines import CUBE, CUBE_OUTLINE
from nsdr.dynamics.planar import PlanarBodies, PlanarMotion, planar_motion
from nsdr.dynamics.states import MotionStates
from nsdr.types import Event

__all__ = ["FitConfig", "FittedMotion", "fit_motion"]

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
UNITS = {"place": 0.01, "velocity": 0.02, "log_mass": 0.17, "yaw": 0.1, "rebound": 0.15}
"""Natural size of a change of each kind of parameter: the optimiser works in these units."""
DIFFERENCE = 0.2
"""Step of the numerical derivatives, in these units."""
EDGES_PX = (-0.3, -0.6)
"""Left and right edges of real masks of cubes lie this much beside those of the drawn outline (medians of ten scenes)."""
_COLUMN, _DEPTH = CAMERA_MATRIX[0].copy(), CAMERA_MATRIX[2].copy()


@dataclass(frozen=True)
class FitConfig:
    """Noise and priors of the fit.

    Attributes:
        place_noise_world: of reliable places.
        unreliable_weight: of covered or cut objects' places.
        edge_noise_px: of the left and right edges of cubes, which tell their turn.
        mass_deviation: of log masses (uniform 0.7-1.3: 0.17).
        rebound, rebound_deviation: what is expected of rebounds.
        robust_scale: residuals beyond so many deviations count less and less.
        least_first_speed: objects start with 2.7 world units per second or more, or at rest: what comes out slower rests.
        least_speed: and so does what is slower than this when it is seen before its first collision.
        margin_frames: so many frames after the collision that ends a window do not belong to it.
        evaluations: of the optimiser for each window.
        turns: first guesses of a cube's turn, over a quarter turn.
        good_cost: fits at most so costly need no other start.
        restarts: other starts tried, at most.
    """

    place_noise_world: float = 0.01
    unreliable_weight: float = 0.03
    edge_noise_px: float = 2.0
    mass_deviation: float = 0.17
    rebound: float = 0.4
    rebound_deviation: float = 0.2
    robust_scale: float = 2.0
    least_first_speed: float = 1.5
    least_speed: float = 0.2
    margin_frames: int = 1
    evaluations: int = 25
    turns: int = 12
    good_cost: float = 0.4
    restarts: int = 6


@dataclass(frozen=True)
class FittedMotion:
    """One run of the simulator that explains a video.

    Attributes:
        bodies: the objects at frame 0.
        rebound: (n, n) fitted rebounds, NaN for pairs that were not expected to collide.
        motion: the run over the video.
        error_world: (n,) median distance from each object's reliable places; NaN without any.
        cost: half the sum of squared, robust residuals for each datum.
    """

    bodies: PlanarBodies
    rebound: FloatArray
    motion: PlanarMotion
    error_world: FloatArray
    cost: float


def fit_motion(states: MotionStates, collisions: Sequence[Event], config: FitConfig | None = None) -> FittedMotion:
    """Fit one run to a video's tracks.

    Args:
        states: of at least one object.
        collisions: during the video, in order of time.
    """
    problem = _Problem(states, collisions, config or FitConfig())
    frames = [*sorted({e.frame for e in collisions}), states.present.shape[1]]
    x = problem.start()
    for end in frames:
        window = min(max(end - problem.config.margin_frames, 8), states.present.shape[1])
        x = problem.solve_with_restarts(x, window)
    return problem.result(x)


@dataclass(frozen=True)
class _Data:
    """What was measured of one object."""

    frame: IntArray
    place: FloatArray
    weight: FloatArray
    edges_px: FloatArray | None
    """(T, 2) left and right of the box, of cubes."""


class _Problem:
    """Parameters <-> runs, and the residuals of a run."""

    def __init__(self, states: MotionStates, collisions: Sequence[Event], config: FitConfig) -> None:
        self.config = config
        self.rng = np.random.default_rng(0)
        self.objects = states.objects
        self.collisions = collisions
        self.shape = np.array([SHAPES.index(o.shape) for o in states.objects])
        self.exists = np.ones(len(self.objects), bool)
        self.frames = states.present.shape[1]
        self.data = [self._measured(states, i) for i in range(len(self.objects))]
        self.reference = np.zeros(len(self.objects))
        self.moving = np.zeros(len(self.objects), bool)
        self.first: list[tuple[FloatArray, FloatArray]] = []
        for i, d in enumerate(self.data):
            self.first.append(self._first_flight(i, d))
        self.names = self._names()
        self.unit = np.array([UNITS[kind] for kind, *_ in self.names])

    def _measured(self, states: MotionStates, i: int) -> _Data:
        frame = np.flatnonzero(states.detected[i])
        weight = np.where(states.reliable[i, frame], 1.0, self.config.unreliable_weight)
        middle, width = states.box_px[i, frame, 0], states.box_px[i, frame, 2]
        edges = np.stack([middle - width / 2, middle + width / 2], 1) if self.shape[i] == CUBE else None
        return _Data(frame, states.location_world[i, frame], weight, edges)

    def _first_flight(self, i: int, d: _Data) -> tuple[FloatArray, FloatArray]:
        """Place and velocity at a frame of the first stretch; sets `reference` and `moving`."""
        hits = [e.frame for e in self.collisions if i in e.objects]
        end = min(hits) - self.config.margin_frames if hits else 10**6
        mine = d.frame < end
        if mine.sum() < 2:
            mine = np.arange(len(d.frame)) < 3
        self.reference[i] = float(np.round(np.average(d.frame[mine], weights=d.weight[mine])))
        shape = self.objects[i].shape
        place, velocity, _ = fit_flight(shape, d.frame[mine], d.place[mine], d.weight[mine], self.reference[i])
        begin = fly(shape, np.hypot(*velocity), np.array(-self.reference[i] * FRAME_SECONDS))[1]
        fast = float(begin) > self.config.least_first_speed and float(np.hypot(*velocity)) > self.config.least_speed
        self.moving[i] = mine.sum() >= 3 and fast
        if not self.moving[i]:
            self.reference[i] = 0.0
            place = np.average(d.place[mine], axis=0, weights=d.weight[mine])
        return place, velocity

    def _names(self) -> list[tuple[str, int, int]]:
        names = []
        for i in range(len(self.objects)):
            names += [("place", i, 0), ("place", i, 1)]
            if self.moving[i]:
                names += [("velocity", i, 0), ("velocity", i, 1)]
            if any(i in e.objects for e in self.collisions):
                names.append(("log_mass", i, 0))
            if self.shape[i] == CUBE:
                names.append(("yaw", i, 0))
        return names + [("rebound", e.objects[0], e.objects[1]) for e in self.collisions]

    def start(self) -> FloatArray:
        """First guess: flights before the first collisions, velocities around each, and cubes' turns by their edges."""
        log_mass, rebound = self._exchanges()
        guess = {
            "place": lambda i, k: self.first[i][0][k],
            "velocity": lambda i, k: self.first[i][1][k],
            "yaw": lambda i, _: self._first_turn(i),
            "log_mass": lambda i, _: log_mass[i],
            "rebound": lambda i, j: rebound[i, j],
        }
        return np.array([guess[kind](i, k) for kind, i, k in self.names]) / self.unit

    def _exchanges(self) -> tuple[FloatArray, dict[tuple[int, ...], float]]:
        """Log masses and rebounds by the velocities before and after each collision."""
        rows, values, rebound = [np.eye(len(self.objects))], [np.zeros(len(self.objects))], {}
        for e in self.collisions:
            rebound[e.objects] = self.config.rebound
            flights = [f for f in (self._around(i, e.frame) for i in e.objects) if f is not None]
            if len(flights) < 2:
                continue
            (place_i, before_i, after_i), (place_j, before_j, after_j) = flights
            normal = (place_j - place_i) / max(float(np.linalg.norm(place_j - place_i)), 1e-6)
            change_i, change_j = np.linalg.norm(after_i - before_i), np.linalg.norm(after_j - before_j)
            approach, parting = (before_i - before_j) @ normal, (after_j - after_i) @ normal
            if approach > 0.3 and min(change_i, change_j) > 0.1:
                rebound[e.objects] = float(np.clip(parting / approach, 0.0, 0.65))
                row = np.zeros((1, len(self.objects)))
                row[0, list(e.objects)] = (1, -1)
                trust = 3.0  # the prior's deviation over that of a measured ratio
                rows.append(trust * row)
                values.append(np.array([trust * np.log(change_j / change_i)]))
        log_mass = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
        return np.clip(log_mass, -0.4, 0.4), rebound

    def _around(self, i: int, frame: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Place of an object at a collision, and its velocity before and after; None where it was seen too little."""
        hits = [e.frame for e in self.collisions if i in e.objects]
        start = max([f for f in hits if f < frame], default=-(10**6))
        end = min([f for f in hits if f > frame], default=10**6)
        found, d, margin = [], self.data[i], self.config.margin_frames
        for low, high in ((start + margin, frame - margin), (frame + margin, end - margin)):
            mine = (d.frame >= low) & (d.frame <= high)
            if mine.sum() < 4:
                return None
            found.append(fit_flight(self.objects[i].shape, d.frame[mine], d.place[mine], d.weight[mine], frame))
        return found[0][0], found[0][1], found[1][1]

    def _first_turn(self, i: int, rng: np.random.Generator | None = None) -> float:
        """The turn whose edges fit best at first, or with `rng` any, the better the likelier."""
        d = self.data[i]
        near = (d.frame <= self.reference[i] + 8) & (d.weight == 1)
        if not near.any():
            return 0.4
        guesses = np.pi / 2 * np.arange(self.config.turns) / self.config.turns
        assert d.edges_px is not None
        errors = [
            np.abs(d.edges_px[near] - _edges_px(d.place[near], np.full(near.sum(), yaw))).mean() for yaw in guesses
        ]
        noise = 0.0 if rng is None else rng.exponential(0.7, len(errors))
        return float(guesses[int(np.argmin(np.array(errors) + noise))])

    def bodies(self, x: FloatArray) -> tuple[PlanarBodies, FloatArray]:
        """Bodies at frame 0, and rebounds."""
        n = len(self.objects)
        place, velocity = np.zeros((n, 2)), np.zeros((n, 2))
        yaw, log_mass, rebound = np.zeros(n), np.zeros(n), np.full((n, n), np.nan)
        for value, (kind, i, k) in zip(x * self.unit, self.names, strict=True):
            if kind == "place":
                place[i, k] = value
            elif kind == "velocity":
                velocity[i, k] = value
            elif kind == "yaw":
                yaw[i] = value
            elif kind == "log_mass":
                log_mass[i] = value
            else:
                rebound[i, k] = rebound[k, i] = min(max(value, 0.0), 0.8)
        for i in np.flatnonzero(self.moving).tolist():
            speed = float(np.hypot(*velocity[i]))
            direction = velocity[i] / max(speed, 1e-9)
            seconds = np.array(-self.reference[i] * FRAME_SECONDS)
            way, then = fly(self.objects[i].shape, np.array(speed), seconds)
            place[i] += float(way) * direction
            velocity[i] = float(then) * direction
        return PlanarBodies(self.shape, place, velocity, yaw, np.zeros(n), np.exp(log_mass)), rebound

    def run(self, x: FloatArray, n_frames: int) -> PlanarMotion:
        bodies, rebound = self.bodies(x)
        return planar_motion(bodies, self.exists, n_frames, rebound)

    def residuals(self, x: FloatArray, n_frames: int) -> FloatArray:
        motion = self.run(x, n_frames)
        c, parts = self.config, []
        for i, d in enumerate(self.data):
            mine = d.frame < n_frames
            frame, root = d.frame[mine], np.sqrt(d.weight[mine])[:, None]
            place = motion.place[i, frame]
            parts.append(((place - d.place[mine]) * root / c.place_noise_world).ravel())
            if d.edges_px is not None:
                off = (_edges_px(place, motion.yaw[i, frame]) - d.edges_px[mine]) / c.edge_noise_px
                parts.append((off * root).ravel())
        parts.append(self._priors(x))
        return np.concatenate(parts)

    def _priors(self, x: FloatArray) -> FloatArray:
        prior = [
            value / self.config.mass_deviation
            if kind == "log_mass"
            else (value - self.config.rebound) / self.config.rebound_deviation
            for value, (kind, *_) in zip(x * self.unit, self.names, strict=True)
            if kind in ("log_mass", "rebound")
        ]
        return np.array(prior)

    def cost(self, x: FloatArray, n_frames: int) -> float:
        """Mean robust loss of a datum."""
        residual, scale = self.residuals(x, n_frames), self.config.robust_scale
        return float((scale**2 * (np.sqrt(1 + (residual / scale) ** 2) - 1)).mean())

    def solve_with_restarts(self, x: FloatArray, n_frames: int) -> FloatArray:
        """The best of several solutions: other starts are tried while the cost is high."""
        c = self.config
        best = self.solve(x, n_frames)
        cost = self.cost(best, n_frames)
        met = [e for e in self.collisions if e.frame < n_frames]
        concerned = {i for e in met[-2:] for i in e.objects}
        for _ in range(c.restarts if met else 0):
            if cost < c.good_cost:
                break
            start = best.copy()
            for k, (kind, i, j) in enumerate(self.names):
                if kind == "rebound" and any(e.objects == (i, j) for e in met[-2:]):
                    start[k] = self.rng.uniform(0, 0.65) / self.unit[k]
                elif kind == "yaw" and i in concerned:
                    start[k] = self._first_turn(i, self.rng) / self.unit[k]
                elif i in concerned and kind in ("place", "velocity", "log_mass"):
                    start[k] += self.rng.normal() * (0.7 if kind == "log_mass" else 1.0)
            trial = self.solve(start, n_frames)
            trial_cost = self.cost(trial, n_frames)
            if trial_cost < cost:
                best, cost = trial, trial_cost
        return best

    def solve(self, x: FloatArray, n_frames: int) -> FloatArray:
        """Robust least squares over the frames below `n_frames`, from a start near the solution."""

        def residuals(step: FloatArray) -> FloatArray:
            return self.residuals(x + step, n_frames)

        def jacobian(step: FloatArray) -> FloatArray:
            base = residuals(step)
            return np.stack([(residuals(step + d) - base) / DIFFERENCE for d in DIFFERENCE * np.eye(len(step))], 1)

        # The first trust region is the norm of the start: by optimising the change from it, one unit.
        solution = least_squares(
            residuals,
            np.zeros(len(x)),
            jacobian,
            loss="soft_l1",
            f_scale=self.config.robust_scale,
            max_nfev=self.config.evaluations,
        )
        return np.asarray(x + solution.x)

    def result(self, x: FloatArray) -> FittedMotion:
        bodies, rebound = self.bodies(x)
        motion = planar_motion(bodies, self.exists, self.frames, rebound)
        errors = []
        for i, d in enumerate(self.data):
            good = d.weight == 1
            distance = np.linalg.norm(motion.place[i, d.frame[good]] - d.place[good], axis=1)
            errors.append(float(np.median(distance)) if good.any() else float("nan"))
        return FittedMotion(bodies, rebound, motion, np.array(errors), self.cost(x, self.frames))


@njit(cache=True)
def _edges_px(place, yaw):  # type: ignore[no-untyped-def]
    """(T, 2) left and right edges of cubes' pictures."""
    edges = np.empty((len(yaw), 2))
    for t in range(len(yaw)):
        c, s = np.cos(yaw[t]), np.sin(yaw[t])
        low, high = 1e4, -1e4
        for k in range(len(CUBE_OUTLINE)):
            x = place[t, 0] + c * CUBE_OUTLINE[k, 0] - s * CUBE_OUTLINE[k, 1]
            y = place[t, 1] + s * CUBE_OUTLINE[k, 0] + c * CUBE_OUTLINE[k, 1]
            for top in range(2):
                z = 2 * OBJECT_RADIUS_WORLD * top
                depth = max(_DEPTH[0] * x + _DEPTH[2] * z + _DEPTH[3], 0.1)
                column = (_COLUMN[0] * x + _COLUMN[1] * y + _COLUMN[2] * z + _COLUMN[3]) / depth
                low, high = min(low, column), max(high, column)
        edges[t, 0], edges[t, 1] = low + EDGES_PX[0], high + EDGES_PX[1]
    return edges
