"""Random scenes of a world with their complete truth: the video, the frames after it, and the collisions without each object.

The construction is the paper's: one object moves; each further participant gets a start state from which it collides with
an object that is there already; simulations in which a pair collides twice are discarded. Bystanders, which touch nothing,
are added last. The distributions of start states were measured on the release's annotations and ground-truth blocks.
"""

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nsdr.errors import DataError
from nsdr.generate.physics.bullet import Body, BulletConfig, BulletMotion, Contact, Simulator
from nsdr.generate.physics.scene_config import SceneConfig, Triple, matches_any
from nsdr.tracking.visibility import in_image
from nsdr.types import SceneObject
from nsdr.validation import FloatArray
from nsdr.world.layout import START_SPACING
from nsdr.world.shapes import RADIUS_WORLD
from nsdr.world.world import CLEVRER_WORLD, World

STATIC_FRACTION = (0.0, 0.6, 0.35, 0.35)
"""Probability that each participant starts at rest (0 for the first one, which moves)."""
PARTNER_WEIGHTS = (1.0, 1.1, 0.5)
"""Relative probability of each participant to be hit by a later one."""
LATE_FRACTION = (0.0, 0.0, 0.55, 0.9)
"""Probability that the planned collision of each moving participant is after the end of the video. In all three tuples, the
last value also holds for later participants."""
EXTRA_FRACTION = 0.3
"""Probability that an object is allowed to cause further collisions besides the planned one."""
FIRST_MEETING_FRAME = (30.0, 15.0)
"""Mean and standard deviation of the frame at which the first two objects collide, in CLEVRER."""
RESTING_DELAY_FRAMES = 36.0
"""Mean of the exponentially distributed delay from the first collision until a later participant that starts at rest is hit, in
CLEVRER. Moving participants collide at any later frame."""
MIN_MEETING_FRAME = 6
"""First frame at which a collision may be planned, in CLEVRER. In other worlds, all three are in proportion to the time in
which an object gets from its start to the origin."""
FIRST_HEADING_DEGREES, HEADING_DEGREES = 28.0, 15.0
"""Max angle between an object's heading and the direction to the origin: for the first object, and for later ones that start as
far out."""
WIDTH_WORLD = 2 * RADIUS_WORLD
"""Width of CLEVRER's objects. In other worlds, the lengths below are in proportion to half the sum of the widths of two
objects, and the speed to the fastest start speed."""
TOUCHING_WORLD = 2.02 * RADIUS_WORLD
"""Distance between the centres at which a planned collision starts."""
PATH_OFFSET_WORLD = 0.14
"""Standard deviation of the distance between an object at rest and the path of the object that hits it."""
MAX_PATH_OFFSET_WORLD = 0.37
"""Max of that distance."""
MIN_HIT_SPEED_WORLD_PER_S = 0.4
"""An object slower than this is not planned to hit one at rest."""
MAX_HEIGHT_CHANGE_WORLD = 0.02
"""A box or cylinder whose centre rises or sinks by more has toppled (world units, for CLEVRER's width)."""
PLACEMENTS = 12
"""Attempts to add an object before the scene is started anew."""
TRIES_PER_FRAME = 30
"""Start states tried for each frame drawn for a participant's collision."""
RESTARTS = 400
"""Attempts at a scene before the configuration is given up."""


@dataclass(frozen=True)
class SimulatedScene:
    """A simulated scene.

    Attributes:
        seed: seed that it was drawn from.
        objects: identities and attributes.
        mass: (n,) relative masses.
        n_frames: frames that the video shows.
        motion: motion over all simulated frames, and the collisions.
        counterfactual: collisions with each object removed, by the removed object's id; bodies are indexed as in `objects`.
            Empty where they were not asked for.
        world: the world that it is in.
    """

    seed: int
    objects: tuple[SceneObject, ...]
    mass: FloatArray
    n_frames: int
    motion: BulletMotion
    counterfactual: Mapping[int, tuple[Contact, ...]]
    world: World = CLEVRER_WORLD


def simulate_scene(
    seed: int, config: SceneConfig | None = None, removals: bool = True, world: World = CLEVRER_WORLD
) -> SimulatedScene:
    """Generate the scene of a seed. It depends on the seed, the configuration and the world only.

    Args:
        seed: 0 or more.
        config: what scenes look like; None is as the world says.
        removals: whether to simulate the scene without each of its objects, too, which doubles the time.
        world: the world that the scene is in.

    Raises:
        DataError: a negative seed, no scene fits the configuration, or PyBullet is not installed.
    """
    if seed < 0:  # `random` takes the absolute value
        raise DataError(f"seed: expected 0 or more, got {seed}")
    config, rng = config or SceneConfig(), random.Random(seed)
    triples, changed = config.triples_in(world), config.world_of(world)
    with Simulator(config.physics, changed) as simulator:
        for _ in range(RESTARTS):
            scene = _Construction(triples, config.only, simulator, rng, world).build()
            if scene is None:
                continue
            chosen, bodies, motion = scene
            objects = tuple(SceneObject(i, *triple) for i, triple in enumerate(chosen))
            mass = np.array([b.mass for b in bodies])
            made = SimulatedScene(seed, objects, mass, changed.timeline.frames, motion, {}, world)
            return _with_removals(made, bodies, simulator) if removals else made
    raise DataError(
        f"seed {seed}: no scene found in {RESTARTS} attempts; the configuration's speed or n_frames allows too few"
    )


def scene_without(scene: SimulatedScene, removed: int, config: BulletConfig | None = None) -> SimulatedScene:
    """The scene from the same start states without one object. The others keep their order, with ids from 0.

    Args:
        scene: a simulated scene.
        removed: id of the object.
        config: parameters of the scene's simulation; None is its world's.
    """
    motion = scene.motion
    kept = [o for o in scene.objects if o.id != removed]
    bodies = [motion.body(o.id, 0, o.shape, float(scene.mass[o.id]), o.material) for o in kept]
    objects = tuple(replace(o, id=i) for i, o in enumerate(kept))
    with Simulator(config, scene.world) as simulator:
        motion = simulator.run(bodies, motion.location_world.shape[1])
        kept_scene = replace(scene, objects=objects, mass=np.array([b.mass for b in bodies]), motion=motion)
        return _with_removals(kept_scene, bodies, simulator)


def removals_by_effect(scene: SimulatedScene) -> list[int]:
    """Ids of all objects, sorted by how many pairs of other objects collide only with or only without the object, most first.

    Of objects that are equal in this, the one that itself collides with more others comes first.
    """
    pairs = {c.bodies for c in scene.motion.contacts}

    def effect(i: int) -> tuple[int, int]:
        others = {pair for pair in pairs if i not in pair}
        return len(others ^ {c.bodies for c in scene.counterfactual[i]}), len(pairs - others)

    return sorted(scene.counterfactual, key=effect, reverse=True)


def _with_removals(scene: SimulatedScene, bodies: Sequence[Body], simulator: Simulator) -> SimulatedScene:
    n_frames = scene.motion.location_world.shape[1]
    without = {i: _without(i, bodies, n_frames, simulator) for i in range(len(bodies))}
    return replace(scene, counterfactual=without)


def _without(removed: int, bodies: Sequence[Body], n_frames: int, simulator: Simulator) -> tuple[Contact, ...]:
    """The first collision of each pair if one object is removed."""
    kept = [i for i in range(len(bodies)) if i != removed]
    motion = simulator.run([bodies[i] for i in kept], n_frames)
    found: dict[tuple[int, int], Contact] = {}
    for c in motion.contacts:
        pair = (kept[c.bodies[0]], kept[c.bodies[1]])
        found.setdefault(pair, Contact(c.frame, pair, c.location_world))
    return tuple(found.values())


class _Construction:
    """One attempt at a scene: objects are added one by one, and each addition is checked by simulating all of them.

    Args:
        triples: allowed combinations of attributes.
        only: see `SceneConfig`.
        simulator: simulates the scenes; its world has the configuration's values.
        rng: makes the random choices.
        usual: the world without the configuration's values, with which the times of collisions are in proportion.
    """

    def __init__(
        self, triples: Sequence[Triple], only: Sequence[str], simulator: Simulator, rng: random.Random, usual: World
    ) -> None:
        self.simulator, self.rng, self.world = simulator, rng, simulator.world
        self.layout, self.physics, self.camera = self.world.layout, self.world.physics, self.world.camera
        self.n_frames = self.world.timeline.frames
        self.simulated_frames = self.world.timeline.horizon_frame(self.n_frames)
        self.speed_scale = usual.scales.speed
        self.time_scale = _arrival_frames(usual) / _arrival_frames(CLEVRER_WORLD)
        probabilities = dict(self.layout.objects)
        numbers = sorted(probabilities)
        self.n = rng.choices(numbers, [probabilities[k] for k in numbers])[0]
        self.triples = rng.sample(triples, self.n)
        while only and not any(matches_any(t, only) for t in self.triples):
            self.triples = rng.sample(triples, self.n)
        self.shapes = [self.world.vocabulary.shape(shape) for _, _, shape in self.triples]
        self.bodies: list[Body] = []
        self.motion: BulletMotion | None = None

    def build(self) -> tuple[list[Triple], list[Body], BulletMotion] | None:
        """Attributes, start states and motion; None if the attempt failed."""
        if not self._add(self._first(), meets=True):
            return None
        participants = min(self.layout.participants, self.n)
        for k in range(1, self.n):
            step = self._participant if k < participants else self._bystander
            if not any(step(k) for _ in range(PLACEMENTS)):
                return None
        motion = self.motion
        assert motion is not None
        for shape, location in zip(self.shapes, motion.location_world, strict=True):
            risen = np.abs(location[:, 2] - shape.height_world).max()
            if shape.solid != "sphere" and risen > MAX_HEIGHT_CHANGE_WORLD * (max(shape.size_world) / WIDTH_WORLD):
                return None
        shown = slice(self.n_frames)
        paths = zip(self.shapes, motion.location_world[:, shown], motion.orientation[:, shown, 2], strict=True)
        if not all(in_image(shape, location, yaw, self.camera).any() for shape, location, yaw in paths):
            return None
        return self.triples, self.bodies, motion

    def _body(self, k: int, x: float, y: float, heading: float, speed: float) -> Body:
        shape, (_, material, word) = self.shapes[k], self.triples[k]
        tilt = math.pi / 2 if shape.solid == "cylinder" else 0.0
        is_square = shape.size_world[0] == shape.size_world[1]
        yaw = self.rng.uniform(0, math.pi / 2 if is_square else math.pi) if shape.solid == "box" else 0.0
        velocity = (speed * math.cos(heading), speed * math.sin(heading), 0.0)
        mass = self.rng.uniform(*self.physics.mass_range)
        place = (x, y, shape.height_world)
        return Body(word, place, (tilt, 0.0, yaw), velocity, mass=mass, material=material)

    def _scale(self, i: int, j: int) -> float:
        """How large two objects are together, relative to CLEVRER's."""
        return (self.shapes[i].radius_world + self.shapes[j].radius_world) / WIDTH_WORLD

    def _first(self) -> Body:
        """The first object, which moves roughly towards the origin."""
        angle, distance = self.rng.uniform(0, 2 * math.pi), self.rng.uniform(*self.layout.start_distance_world)
        deviation = math.radians(self.rng.uniform(-1, 1) * FIRST_HEADING_DEGREES)
        speed = self.rng.uniform(*self.physics.start_speed_world_per_s)
        return self._body(0, distance * math.cos(angle), distance * math.sin(angle), angle + math.pi + deviation, speed)

    def _participant(self, k: int) -> bool:
        """Add an object that collides at a random frame; False if none of the start states that are tried fits."""
        resting = self.rng.random() < _of_participant(STATIC_FRACTION, k)
        frame = self._meeting_frame(k, resting)
        if not MIN_MEETING_FRAME * self.time_scale <= frame < self.simulated_frames:
            return False
        step = self._resting_participant if resting else self._moving_participant
        return any(step(k, frame) for _ in range(TRIES_PER_FRAME))

    def _meeting_frame(self, k: int, resting: bool) -> int:
        """The frame at which participant k is planned to collide."""
        if k == 1:
            return round(self.rng.gauss(*(frames * self.time_scale for frames in FIRST_MEETING_FRAME)))
        assert self.motion is not None
        first = self.motion.contacts[0].frame
        if resting:
            return first + 1 + int(self.rng.expovariate(1 / (RESTING_DELAY_FRAMES * self.time_scale)))
        low, high = first + 1, self.n_frames
        if self.rng.random() < _of_participant(LATE_FRACTION, k):
            low, high = max(low, high), self.simulated_frames
        return self.rng.randrange(low, high) if low < high else high

    def _partner(self) -> int:
        """Index of the object with which a new participant is planned to collide."""
        numbers = range(len(self.bodies))
        return self.rng.choices(numbers, [_of_participant(PARTNER_WEIGHTS, j) for j in numbers])[0]

    def _resting_participant(self, k: int, frame: int) -> bool:
        """Add an object at rest on or beside the path of a moving object."""
        assert self.motion is not None
        j = self._partner()
        (x, y), (vx, vy) = self.motion.location_world[j, frame, :2], self.motion.velocity[j, frame, :2]
        if math.hypot(vx, vy) < MIN_HIT_SPEED_WORLD_PER_S * self.speed_scale:
            return False
        heading, scale = math.atan2(vy, vx), self._scale(j, k)
        offset, most = self.rng.gauss(0, PATH_OFFSET_WORLD * scale), MAX_PATH_OFFSET_WORLD * scale
        offset = max(-most, min(most, offset))
        ahead = math.sqrt((TOUCHING_WORLD * scale) ** 2 - offset**2)
        x += ahead * math.cos(heading) - offset * math.sin(heading)
        y += ahead * math.sin(heading) + offset * math.cos(heading)
        return self._in_area(x, y) and self._add(self._body(k, x, y, 0.0, 0.0), meets=True)

    def _moving_participant(self, k: int, frame: int) -> bool:
        """Add an object that starts farther away and hits another one centrally at the given frame."""
        assert self.motion is not None
        j = self._partner()
        (x, y), (vx, vy) = self.motion.location_world[j, frame, :2], self.motion.velocity[j, frame, :2]
        heading, speed = self.rng.uniform(0, 2 * math.pi), self.rng.uniform(*self.physics.start_speed_world_per_s)
        if not self._in_area(x, y):
            return False
        slid, arrival_speed = self._slide(k, speed, frame)
        approach = math.atan2(arrival_speed * math.sin(heading) - vy, arrival_speed * math.cos(heading) - vx)
        touching = TOUCHING_WORLD * self._scale(j, k)
        x -= touching * math.cos(approach) + slid * math.cos(heading)
        y -= touching * math.sin(approach) + slid * math.sin(heading)
        to_origin = math.atan2(-y, -x)
        deviation = abs((heading - to_origin + math.pi) % (2 * math.pi) - math.pi)
        distance = math.hypot(x, y)
        if distance > self.layout.far_world:
            return False
        if distance > self.layout.start_distance_world[0] and deviation > math.radians(HEADING_DEGREES):
            return False
        return self._add(self._body(k, x, y, heading, speed), meets=True)

    def _bystander(self, k: int) -> bool:
        """Add an object at rest that nothing touches."""
        x0, x1, y0, y1 = self.layout.area_world
        return self._add(self._body(k, self.rng.uniform(x0, x1), self.rng.uniform(y0, y1), 0.0, 0.0), meets=False)

    def _add(self, body: Body, meets: bool) -> bool:
        """Add an object if the simulation with it is admissible.

        Args:
            body: start state.
            meets: whether it must collide in the image, but not before the first collision; otherwise it must touch nothing.
        """
        new = len(self.bodies)
        x, y, _ = body.location_world
        for i, other in enumerate(self.bodies):
            both = self.shapes[i].half_width_world + self.shapes[new].half_width_world
            if math.dist((x, y), other.location_world[:2]) < START_SPACING * both:
                return False
        if not meets and self.motion is not None:
            gap = np.linalg.norm(self.motion.location_world[..., :2] - np.array([x, y]), axis=-1).min(1)
            if any(least < TOUCHING_WORLD * self._scale(i, new) for i, least in enumerate(gap)):
                return False

        known = len(self.motion.contacts) if self.motion else 0
        max_contacts = new * len(self.bodies) if self.rng.random() < EXTRA_FRACTION else known + 1

        def inadmissible(contacts: list[Contact]) -> bool:
            if len(contacts) > max_contacts:
                return True
            pairs = [c.bodies for c in contacts]
            too_early = new > 1 and new in pairs[0]
            return len(set(pairs)) < len(pairs) or too_early or (not meets and new in pairs[-1])

        motion = self.simulator.run([*self.bodies, body], self.simulated_frames, stop=inadmissible)
        if not motion.complete:
            return False
        if meets and new and not any(new in c.bodies and self._is_in_image(c) for c in motion.contacts):
            return False
        self.bodies.append(body)
        self.motion = motion
        return True

    def _is_in_image(self, contact: Contact) -> bool:
        """Whether the image shows a point of contact."""
        u, v = self.camera.pixels(contact.location_world)
        return bool(0 < u < self.camera.width and 0 < v < self.camera.height)

    def _in_area(self, x: float, y: float) -> bool:
        x0, x1, y0, y1 = self.layout.area_world
        return x0 <= x <= x1 and y0 <= y <= y1

    def _slide(self, k: int, speed: float, frames: int) -> tuple[float, float]:
        """Distance that object `k` slides undisturbed (world units), and its final speed (world units/s).

        Euler steps of one frame. Seeds depend on its exact values, so it does not use `nsdr.dynamics.sliding.slide`.
        """
        config, (_, material, shape) = self.simulator.config, self.triples[k]
        drag = 0.0
        if self.shapes[k].solid != "sphere":
            drag = config.friction_of(self.world, shape, material) * config.gravity_of(self.world)
        damping, step = self.physics.linear_damping, self.physics.step_seconds * self.physics.steps_per_frame
        distance = 0.0
        for _ in range(frames):
            distance += speed * step
            speed = max(0.0, speed - (damping * speed + damping * speed**2 + drag) * step)
        return distance, speed


def _arrival_frames(world: World) -> float:
    """Number of frames in which an object gets from its start to the origin, without friction."""
    near, far = world.layout.start_distance_world
    slow, fast = world.physics.start_speed_world_per_s
    return (near + far) / (slow + fast) / world.physics.frame_seconds


def _of_participant(values: Sequence[float], k: int) -> float:
    return values[min(k, len(values) - 1)]
