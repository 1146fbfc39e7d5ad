"""Random CLEVRER scenes with their whole truth: what happens, what happens later, and what without each object.

The construction is the paper's: one moving object; each further participant gets a start from which it meets one that is
there already; simulations in which a pair collides twice are discarded. Bystanders, which touch nothing, come last.
Distributions of starts were measured on the release's annotations and ground-truth blocks.
"""

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.generate.physics.bullet import Body, BulletConfig, BulletMotion, Contact, Simulator
from nsdr.tracking.visibility import in_image
from nsdr.types import SceneObject
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX, pixels_from_world
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.vocabulary import COLORS, MATERIALS, SHAPES

__all__ = ["SceneConfig", "SimulatedScene", "simulate_scene"]

FloatArray = NDArray[np.floating[Any]]
TOUCHING_WORLD = 2.02 * OBJECT_RADIUS_WORLD
"""Distance of the centres at which a planned meeting takes position."""
MIN_START_DISTANCE_WORLD = 0.83
"""Least distance of two objects at frame 0 in the release."""
PATH_OFFSET_WORLD, MAX_OFFSET_WORLD = 0.14, 0.37
"""Standard deviation and greatest distance of a resting object from the path on which it is hit."""
MIN_SPEED = 0.4
"""A path slower than that (world units per second) is no position to be hit."""
PLACEMENTS, TRIES_AT_A_FRAME, RESTARTS = 12, 30, 400
"""Tries for one object before the scene is begun anew (for participants: at each of that many frames), and beginnings before
the configuration is given up."""


@dataclass(frozen=True)
class SceneConfig:
    """What scenes look like. The defaults match the released videos.

    Attributes:
        objects: probability of each number of objects (normalised); up to `participants` take part in collisions, the
            others rest as bystanders.
        participants: how many objects the recursive process adds.
        static_fraction: for each participant in turn, the probability that it rests at first (0 for the first one).
        partner_weights: how readily each participant is chosen to be met by a later one.
        first_meeting: mean and standard deviation of the frame at which the first two objects meet.
        resting_delay: mean number of frames from then until a later, resting participant is hit (exponential); moving ones
            meet at any later frame.
        late_fraction: for each participant, the probability that a moving one is planned to meet another only after the video.
        shapes: allowed words.
        colors: allowed words.
        materials: allowed words.
        held_out: triples "color material shape" (or parts, such as "red cube") that do not occur.
        only: when given, at least one object of each scene is one of these triples or parts: the complement of
            `held_out`, for compositional splits.
        extra_fraction: probability that an object may cause more collisions than its planned one.
        speed: least and greatest initial speed, world units per second.
        mass: least and greatest mass.
        first_distance: least and greatest distance of the first object from the origin.
        first_heading_degrees: greatest angle between its heading and the origin.
        heading_degrees: the same for later moving objects.
        far_world: greatest distance from the origin at which an object starts.
        area: least x, greatest x, least y, greatest y of planned meetings and resting objects.
        n_frames: frames of the video; 7/5 of them are simulated.
        physics: the simulation's parameters.
    """

    objects: Mapping[int, float] = field(default_factory=lambda: {4: 0.36, 5: 0.335, 6: 0.305})
    participants: int = 4
    static_fraction: tuple[float, ...] = (0.0, 0.6, 0.35, 0.35)
    partner_weights: tuple[float, ...] = (1.0, 1.1, 0.5)
    first_meeting: tuple[float, float] = (30.0, 15.0)
    resting_delay: float = 36.0
    late_fraction: tuple[float, ...] = (0.0, 0.0, 0.55, 0.9)
    extra_fraction: float = 0.3
    shapes: tuple[str, ...] = SHAPES
    colors: tuple[str, ...] = COLORS
    materials: tuple[str, ...] = MATERIALS
    held_out: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    speed: tuple[float, float] = (2.7, 3.0)
    mass: tuple[float, float] = (0.7, 1.3)
    first_distance: tuple[float, float] = (3.15, 3.91)
    first_heading_degrees: float = 28.0
    heading_degrees: float = 15.0
    far_world: float = 10.5
    area: tuple[float, float, float, float] = (-2.25, 1.15, -1.6, 1.5)
    n_frames: int = 128
    physics: BulletConfig = field(default_factory=BulletConfig)

    def __post_init__(self) -> None:
        for name, words, known in (
            ("shapes", self.shapes, SHAPES),
            ("colors", self.colors, COLORS),
            ("materials", self.materials, MATERIALS),
        ):
            if not words or set(words) - set(known):
                raise DataError(f"{name}: expected some of {', '.join(known)}, got {', '.join(words) or 'none'}")
        if (
            not self.objects
            or min(self.objects) < 2
            or min(self.objects.values()) < 0
            or not any(self.objects.values())
        ):
            raise DataError(f"objects: expected probabilities of 2 objects or more, got {dict(self.objects)}")
        if self.n_frames < 10:
            raise DataError(f"n_frames: expected at least 10, got {self.n_frames}")
        if len(self.triples) < max(self.objects):
            raise DataError(
                f"shapes, colors, materials and held_out leave {len(self.triples)} kinds of objects for scenes of "
                f"{max(self.objects)}; triples do not repeat in a scene"
            )
        if self.only and not any(_matches(t, self.only) for t in self.triples):
            raise DataError(f"only: none of {', '.join(self.only)} is left by shapes, colors, materials and held_out")

    @property
    def triples(self) -> list[tuple[str, str, str]]:
        """Allowed (color, material, shape)."""
        every = [(c, m, s) for c in self.colors for m in self.materials for s in self.shapes]
        return [t for t in every if not _matches(t, self.held_out)]

    @property
    def simulated_frames(self) -> int:
        """7/5 of the video, as in the paper."""
        return round(self.n_frames * 7 / 5)


def _matches(triple: tuple[str, str, str], patterns: Sequence[str]) -> bool:
    return any(set(pattern.split()) <= set(triple) for pattern in patterns)


@dataclass(frozen=True)
class SimulatedScene:
    """A scene and everything about it.

    Attributes:
        seed: what it was drawn from.
        objects: identities.
        mass: (n,) relative masses.
        n_frames: frames that the video shows.
        motion: all simulated frames, and collisions.
        visible: (n, F) bool, in the image of CLEVRER's camera.
        counterfactual: collisions with each object removed, by its id; bodies are numbered as in `objects`.
    """

    seed: int
    objects: tuple[SceneObject, ...]
    mass: FloatArray
    n_frames: int
    motion: BulletMotion
    visible: NDArray[np.bool_]
    counterfactual: Mapping[int, tuple[Contact, ...]]


def simulate_scene(seed: int, config: SceneConfig | None = None, simulator: Simulator | None = None) -> SimulatedScene:
    """The scene of a seed; the same for the same configuration, whatever was simulated before.

    Raises:
        DataError: the configuration leaves no scenes to be found, or PyBullet is missing.
    """
    config = config or SceneConfig()
    if simulator is None:
        with Simulator(config.physics) as own:
            return simulate_scene(seed, config, own)
    rng = random.Random(seed)
    for _ in range(RESTARTS):
        scene = _Construction(config, simulator, rng).build()
        if scene is None:
            continue
        triples, bodies, motion, visible = scene
        without = {i: _without(i, bodies, config, simulator) for i in range(len(bodies))}
        objects = tuple(SceneObject(i, *triple) for i, triple in enumerate(triples))
        mass = np.array([b.mass for b in bodies])
        return SimulatedScene(seed, objects, mass, config.n_frames, motion, visible, without)
    raise DataError(
        f"seed {seed}: no scene found in {RESTARTS} tries; the configuration's area, speeds or frames leave too few"
    )


def _without(removed: int, bodies: Sequence[Body], config: SceneConfig, simulator: Simulator) -> tuple[Contact, ...]:
    kept = [i for i in range(len(bodies)) if i != removed]
    motion = simulator.run([bodies[i] for i in kept], config.simulated_frames)
    found: dict[tuple[int, int], Contact] = {}
    for c in motion.contacts:
        pair = (kept[c.bodies[0]], kept[c.bodies[1]])
        found.setdefault(pair, Contact(c.frame, pair, c.location_world))
    return tuple(found.values())


class _Construction:
    """One attempt at a scene: objects are added one after another, each checked by simulating all."""

    def __init__(self, config: SceneConfig, simulator: Simulator, rng: random.Random) -> None:
        self.config, self.simulator, self.rng = config, simulator, rng
        numbers = sorted(config.objects)
        self.n = rng.choices(numbers, [config.objects[k] for k in numbers])[0]
        self.triples = self._draw_triples()
        self.bodies: list[Body] = []
        self.motion: BulletMotion | None = None

    def build(self) -> tuple[list[tuple[str, str, str]], list[Body], BulletMotion, NDArray[np.bool_]] | None:
        """Triples, start states, motion and visibility; None when this attempt failed."""
        if not self._add(self._first(), meets=True):
            return None
        participants = min(self.config.participants, self.n)
        for k in range(1, self.n):
            step = self._participant if k < participants else self._bystander
            if not any(step(k) for _ in range(PLACEMENTS)):
                return None
        assert self.motion is not None
        if any(self._tilted(i) for i in range(self.n)):
            return None
        visible = np.stack([self._visible(i) for i in range(self.n)])
        if not visible[:, : self.config.n_frames].any(1).all():
            return None
        return self.triples, self.bodies, self.motion, visible

    def _draw_triples(self) -> list[tuple[str, str, str]]:
        while True:
            triples = self.rng.sample(self.config.triples, self.n)
            if not self.config.only or any(_matches(t, self.config.only) for t in triples):
                return triples

    def _body(self, k: int, x: float, y: float, heading: float, speed: float) -> Body:
        shape = self.triples[k][2]
        tilt = math.pi / 2 if shape == "cylinder" else 0.0
        yaw = self.rng.uniform(0, math.pi / 2) if shape == "cube" else 0.0
        velocity = (speed * math.cos(heading), speed * math.sin(heading), 0.0)
        mass = self.rng.uniform(*self.config.mass)
        return Body(shape, (x, y, OBJECT_RADIUS_WORLD), (tilt, 0.0, yaw), velocity, mass=mass)

    def _first(self) -> Body:
        angle, distance = self.rng.uniform(0, 2 * math.pi), self.rng.uniform(*self.config.first_distance)
        turn = math.radians(self.rng.uniform(-1, 1) * self.config.first_heading_degrees)
        speed = self.rng.uniform(*self.config.speed)
        return self._body(0, distance * math.cos(angle), distance * math.sin(angle), angle + math.pi + turn, speed)

    def _participant(self, k: int) -> bool:
        resting = self.rng.random() < _of(self.config.static_fraction, k)
        frame = self._meeting_frame(k, resting)
        if not 6 <= frame < self.config.simulated_frames:
            return False
        step = self._resting_participant if resting else self._moving_participant
        return any(step(k, frame) for _ in range(TRIES_AT_A_FRAME))

    def _meeting_frame(self, k: int, resting: bool) -> int:
        if k == 1:
            return round(self.rng.gauss(*self.config.first_meeting))
        assert self.motion is not None
        first = self.motion.contacts[0].frame
        if resting:
            return first + 1 + int(self.rng.expovariate(1 / self.config.resting_delay))
        low, high = first + 1, self.config.n_frames
        if self.rng.random() < _of(self.config.late_fraction, k):
            low, high = max(low, high), self.config.simulated_frames
        return self.rng.randrange(low, high) if low < high else high

    def _partner(self) -> int:
        numbers = range(len(self.bodies))
        return self.rng.choices(numbers, [_of(self.config.partner_weights, j) for j in numbers])[0]

    def _resting_participant(self, k: int, frame: int) -> bool:
        """Rests on or beside the path of a moving object."""
        assert self.motion is not None
        j = self._partner()
        (x, y), (vx, vy) = self.motion.location_world[j, frame, :2], self.motion.velocity[j, frame, :2]
        if math.hypot(vx, vy) < MIN_SPEED:
            return False
        heading = math.atan2(vy, vx)
        offset = max(-MAX_OFFSET_WORLD, min(MAX_OFFSET_WORLD, self.rng.gauss(0, PATH_OFFSET_WORLD)))
        ahead = math.sqrt(TOUCHING_WORLD**2 - offset**2)
        x += ahead * math.cos(heading) - offset * math.sin(heading)
        y += ahead * math.sin(heading) + offset * math.cos(heading)
        return self._in_area(x, y) and self._add(self._body(k, x, y, 0.0, 0.0), meets=True)

    def _moving_participant(self, k: int, frame: int) -> bool:
        """Comes from farther away and meets the middle of another object at a frame."""
        assert self.motion is not None
        j = self._partner()
        (x, y), (vx, vy) = self.motion.location_world[j, frame, :2], self.motion.velocity[j, frame, :2]
        heading, speed = self.rng.uniform(0, 2 * math.pi), self.rng.uniform(*self.config.speed)
        if not self._in_area(x, y):
            return False
        way, arrives = _slide(self.triples[k][2], speed, frame, self.config.physics)
        approach = math.atan2(arrives * math.sin(heading) - vy, arrives * math.cos(heading) - vx)
        x -= TOUCHING_WORLD * math.cos(approach) + way * math.cos(heading)
        y -= TOUCHING_WORLD * math.sin(approach) + way * math.sin(heading)
        to_origin = math.atan2(-y, -x)
        aside = abs((heading - to_origin + math.pi) % (2 * math.pi) - math.pi)
        distance = math.hypot(x, y)
        if distance > self.config.far_world:
            return False
        if distance > self.config.first_distance[0] and aside > math.radians(self.config.heading_degrees):
            return False
        return self._add(self._body(k, x, y, heading, speed), meets=True)

    def _bystander(self, k: int) -> bool:
        """Rests where nothing comes along."""
        x0, x1, y0, y1 = self.config.area
        return self._add(self._body(k, self.rng.uniform(x0, x1), self.rng.uniform(y0, y1), 0.0, 0.0), meets=False)

    def _add(self, body: Body, meets: bool) -> bool:
        """Add an object when the simulation with it is admissible: it meets another (after the first collision), or none."""
        new = len(self.bodies)
        x, y, _ = body.location_world
        if any(math.dist((x, y), b.location_world[:2]) < MIN_START_DISTANCE_WORLD for b in self.bodies):
            return False
        if not meets and self.motion is not None:
            gap = np.linalg.norm(self.motion.location_world[..., :2] - np.array([x, y]), axis=-1)
            if gap.min() < TOUCHING_WORLD:
                return False

        known = len(self.motion.contacts) if self.motion else 0
        most = new * len(self.bodies) if self.rng.random() < self.config.extra_fraction else known + 1

        def inadmissible(contacts: list[Contact]) -> bool:
            if len(contacts) > most:
                return True
            pairs = [c.bodies for c in contacts]
            too_early = new > 1 and new in pairs[0]
            return len(set(pairs)) < len(pairs) or too_early or (not meets and new in pairs[-1])

        motion = self.simulator.run([*self.bodies, body], self.config.simulated_frames, stop=inadmissible)
        if not motion.complete:
            return False
        if meets and new and not any(new in c.bodies and self._in_image(c) for c in motion.contacts):
            return False
        self.bodies.append(body)
        self.motion = motion
        return True

    def _in_image(self, contact: Contact) -> bool:
        u, v = pixels_from_world(contact.location_world)
        return bool(0 < u < WIDTH_PX and 0 < v < HEIGHT_PX)

    def _in_area(self, x: float, y: float) -> bool:
        x0, x1, y0, y1 = self.config.area
        return x0 <= x <= x1 and y0 <= y <= y1

    def _tilted(self, i: int) -> bool:
        """Whether a cube or cylinder topples."""
        assert self.motion is not None
        if self.bodies[i].shape == "sphere":
            return False
        return bool(np.abs(self.motion.location_world[i, :, 2] - OBJECT_RADIUS_WORLD).max() > 0.02)

    def _visible(self, i: int) -> NDArray[np.bool_]:
        assert self.motion is not None
        motion = self.motion
        return in_image(self.bodies[i].shape, motion.location_world[i], motion.orientation[i, :, 2])


def _of(values: Sequence[float], k: int) -> float:
    """The k-th value; the last one goes on."""
    return values[min(k, len(values) - 1)]


def _slide(shape: str, speed: float, frames: int, physics: BulletConfig) -> tuple[float, float]:
    """How far an undisturbed object slides, and its speed then: it loses 0.04 v + 0.04 v^2 to damping, and friction."""
    drag = 0.0 if shape == "sphere" else physics.friction * physics.gravity
    step = physics.step_s * physics.steps_per_frame
    length = 0.0
    for _ in range(frames):
        length += speed * step
        speed = max(0.0, speed - (0.04 * speed + 0.04 * speed**2 + drag) * step)
    return length, speed
