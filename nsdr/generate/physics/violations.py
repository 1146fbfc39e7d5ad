"""Scenes that break exactly one law of CLEVRER's world, made from lawful ones.

A scene is changed at one frame, and Bullet simulates on from there: but for the one change, everything is lawful.
"""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nsdr.generate.physics.bullet import Body, BulletMotion, Contact, Simulator
from nsdr.generate.physics.scene import SimulatedScene
from nsdr.tracking.visibility import cut_sides, hidden_sides, in_image
from nsdr.types import SceneObject, Violation
from nsdr.validation import BoolArray
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.physics_constants import FRAME_SECONDS, GROUND_FRICTION, OBJECT_RADIUS_WORLD
from nsdr.world.shapes import surface_points
from nsdr.world.vocabulary import COLORS, MATERIALS, SHAPES, differing_words

SIZES = ("clear", "small", "limit")
"""How easily a violation is seen; the last ones are at the limit of what positions known to 0.003 world units show."""
AMOUNTS = {
    "permanence": (math.inf, 16, 6),
    "identity": (math.inf, 40, 10),
    "continuity": (0.4, 0.1, 0.03),
    "inertia": (1.0, 0.3, 0.1),
    "friction": (1.2, 0.5, 0.15),
    "solidity": (0.1, 0.2, 0.32),
    "reaction": (1.9, 1.3, 0.9),
    "distance": (0.4, 0.2, 0.08),
    "arrow": (2, 1, 0),
    "standstill": (15, 8, 5),
}
"""By law, for `SIZES`: frames that an object is missing; frames that it has other words (all three, or its colour); how far it
jumps (world units); change of its velocity (world units/s); further deceleration (world units/s²); least distance of centres
while one object passes through another (world units, at most); restitution, but in half of the clear ones one of the two does
not react at all; gap at which two objects repel (world units); collisions well seen in the video, which is played backwards;
frames that show the same."""
CALM_FRAMES = 12
"""Frames on both sides of a change in which its objects are fully in view and touch nothing."""
SLIDING_FRAMES = 40
"""The same after a change of friction, which takes time to show."""
SEEN_SHARE = 0.5
"""Least share of the frames around a collision in which each of its objects is not hidden, not even in part."""
MOVING_SPEED = 0.5
"""Least speed of objects whose friction, or motion while unseen, is to be judged (world units/s)."""
SPACE_WORLD = 3.2 * OBJECT_RADIUS_WORLD
"""Least distance of the centres of an object that jumps or turns up from all others (world units)."""
MIN_CLOSING_SPEED, MIN_RESTITUTION = 0.5, 0.4
"""Of collisions whose effect is changed: least speed of approach (world units/s), and share of it with which they part."""
BEFORE, AFTER = 2, 3
"""Frames before and after a collision at which velocities are those before and after it."""
AWAY_WORLD = (60.0, 0.0, OBJECT_RADIUS_WORLD)
"""Where objects are that are not there: behind the camera."""
_STATES = ("location_world", "orientation", "velocity", "angular_velocity")

Change = tuple[SimulatedScene, Violation]


def break_law(scene: SimulatedScene, law: str, size: str, seed: int) -> Change | None:
    """The scene with a law broken once, and what was done; None where this scene gives no occasion.

    An object whose words change is two objects, of which the second takes the first one's place. Objects that are not there are
    behind the camera.

    Args:
        scene: a lawful scene with CLEVRER's physics.
        law: one of `nsdr.types.LAWS`.
        size: one of `SIZES`.
        seed: of the random choices.
    """
    with Simulator() as simulator:
        world = _World(scene, simulator, random.Random(seed))
        return _BREAK[law](world, AMOUNTS[law][SIZES.index(size)], SIZES.index(size))


@dataclass
class _World:
    """A scene, what is seen of it, and how it goes on with a change."""

    scene: SimulatedScene
    simulator: Simulator
    rng: random.Random

    def __post_init__(self) -> None:
        motion, n_frames = self.scene.motion, self.scene.n_frames
        boxes = np.full((len(self.scene.objects), n_frames, 4), np.nan)
        for o in self.scene.objects:
            location, yaw = motion.location_world[o.id, :n_frames], motion.orientation[o.id, :n_frames, 2]
            for f in np.flatnonzero(in_image(o.shape, location, yaw)):
                outline = CLEVRER_CAMERA.pixels(surface_points(o.shape, float(yaw[f])) + location[f])
                boxes[o.id, f] = *outline.min(0), *outline.max(0)
        seen = np.isfinite(boxes).all(-1)
        self.whole: BoolArray = seen & ~cut_sides(boxes).any(-1)
        self.unhidden: BoolArray = seen & ~hidden_sides(boxes.transpose(1, 0, 2)).any(-1).T
        self.clear = self.unhidden.copy()
        for contact in motion.contacts:
            start = max(contact.frame - CALM_FRAMES, 0)
            for i in contact.bodies:
                self.clear[i, start : contact.frame + CALM_FRAMES // 2] = False

    def moments(self, frames: int = CALM_FRAMES, speed: float = 0.0) -> list[tuple[int, int]]:
        """(object, frame) at which an object that is faster than `speed` is in clear view and calm, and stays so for `frames`,
        in random order."""
        fast = np.linalg.norm(self.scene.motion.velocity[..., :2], axis=-1) >= speed
        found = [
            (o.id, f)
            for o in self.scene.objects
            for f in range(CALM_FRAMES, self.scene.n_frames - CALM_FRAMES)
            if self.clear[o.id, f - CALM_FRAMES : f + frames].all() and fast[o.id, f]
        ]
        self.rng.shuffle(found)
        return found

    def collisions(self) -> list[Contact]:
        """Collisions of objects that are well seen and touch nothing else for some frames, in random order."""
        n_frames, contacts, found = self.scene.n_frames, self.scene.motion.contacts, []
        for c in contacts:
            start, end = c.frame - CALM_FRAMES, c.frame + CALM_FRAMES
            others = [o for o in contacts if o is not c and set(o.bodies) & set(c.bodies)]
            alone = not any(start < o.frame < end for o in others)
            if alone and start >= 0 and end < n_frames:
                bodies = list(c.bodies)
                seen = self.unhidden[bodies, start:end].mean(1).min() >= SEEN_SHARE
                if seen and self.whole[bodies, start : end + 1].all():
                    found.append(c)
        self.rng.shuffle(found)
        return found

    def body(self, i: int, frame: int) -> Body:
        """An object's state in a frame."""
        return self.scene.motion.body(i, frame, self.scene.objects[i].shape, float(self.scene.mass[i]))

    def resumed(
        self, frame: int, changed: dict[int, Body | None], passing: tuple[int, int] | None = None
    ) -> SimulatedScene:
        """The scene as it goes on when objects are in other states (or not there) from a frame on.

        Args:
            frame: of the change.
            changed: states in that frame, by object id.
            passing: two objects that pass through each other.
        """
        motion, total = self.scene.motion, self.scene.motion.location_world.shape[1]
        bodies = {o.id: changed.get(o.id, self.body(o.id, frame)) for o in self.scene.objects}
        there = [i for i, body in bodies.items() if body is not None]
        through = None if passing is None else (there.index(passing[0]), there.index(passing[1]))
        run = self.simulator.run([b for b in bodies.values() if b is not None], total - frame, passing=through)
        states: dict[str, Any] = {name: getattr(motion, name).copy() for name in _STATES}
        for name, values in states.items():
            values[there, frame:] = getattr(run, name)
        before = [c for c in motion.contacts if c.frame < frame]
        met = {c.bodies for c in before if c.frame > frame - CALM_FRAMES}  # still the same collision
        after = [
            Contact(c.frame + frame, (there[c.bodies[0]], there[c.bodies[1]]), c.location_world) for c in run.contacts
        ]
        after = [c for c in after if c.bodies not in met or c.frame > frame + CALM_FRAMES]
        changed_motion = replace(motion, **states, contacts=(*before, *after))
        gone = [i for i, body in bodies.items() if body is None]
        return without(replace(self.scene, motion=changed_motion, counterfactual={}), gone, slice(frame, None))

    def is_calm(self, scene: SimulatedScene, objects: Sequence[int], frame: int) -> bool:
        """Whether objects are in the image and touch nothing new in the frames after a change."""
        last, motion = frame + CALM_FRAMES, scene.motion
        for i in objects:
            if any(i in c.bodies and frame <= c.frame <= last for c in motion.contacts):
                return False
            shown = slice(frame, last + 1)
            path, yaw = motion.location_world[i, shown], motion.orientation[i, shown, 2]
            if not in_image(scene.objects[i].shape, path, yaw).all():
                return False
        return True

    def has_space(self, i: int, frame: int, x: float, y: float) -> bool:
        """Whether an object fits at a place."""
        others = np.delete(self.scene.motion.location_world[:, frame, :2], i, axis=0)
        return bool((np.linalg.norm(others - np.array([x, y]), axis=1) > SPACE_WORLD).all())

    def violation(self, law: str, objects: Sequence[int], start: int, end: int, amount: float, unit: str) -> Violation:
        return Violation(law, tuple(objects), start, min(end, self.scene.n_frames), round(float(amount), 4), unit)


def without(scene: SimulatedScene, objects: Sequence[int], frames: slice | BoolArray) -> SimulatedScene:
    """The scene with objects behind the camera in some frames: a slice, or (T,) bool."""
    location = scene.motion.location_world.copy()
    location[list(objects), frames] = AWAY_WORLD
    return replace(scene, motion=replace(scene.motion, location_world=location))


def _turned(x: float, y: float, angle: float, length: float) -> tuple[float, float]:
    return x + length * math.cos(angle), y + length * math.sin(angle)


def _permanence(world: _World, frames: float, size: int) -> Change | None:
    """Not there: from a frame on, up to a frame, or for some frames."""
    for i, f in world.moments(CALM_FRAMES + (0 if math.isinf(frames) else int(frames)), MOVING_SPEED * (size > 0)):
        if math.isinf(frames) and world.rng.random() < 0.5:
            if any(i in c.bodies and c.frame <= f for c in world.scene.motion.contacts):
                continue
            scene, start, end = without(world.scene, [i], slice(f)), 0, f
            return scene, world.violation("permanence", [i], end, end, end, "frames")
        if math.isinf(frames):
            scene, start, end = world.resumed(f, {i: None}), f, world.scene.n_frames
        else:
            start, end = f, f + int(frames)
            scene = without(world.scene, [i], slice(start, end))
        return scene, world.violation("permanence", [i], start, end, end - start, "frames")
    return None


def _identity(world: _World, frames: float, size: int) -> Change | None:
    """Another object in its place: with other words altogether, or another colour."""
    scene, rng = world.scene, world.rng
    names = {o.name for o in scene.objects}
    for i, f in world.moments(CALM_FRAMES + (0 if math.isinf(frames) else int(frames))):
        old = scene.objects[i]
        color = rng.choice([c for c in COLORS if c != old.color])
        material, shape = old.material, old.shape
        if size == 0:
            material = rng.choice([m for m in MATERIALS if m != old.material])
            shape = rng.choice([s for s in SHAPES if s != old.shape])
        new = SceneObject(len(scene.objects), color, material, shape)
        if new.name in names:
            continue
        end, changed = scene.n_frames if math.isinf(frames) else f + int(frames), scene
        if size == 0:
            tilt = math.pi / 2 if shape == "cylinder" else 0.0
            body = replace(world.body(i, f), shape=shape, orientation=(tilt, 0.0, 0.0), angular_velocity=(0.0,) * 3)
            changed = world.resumed(f, {i: body})
        doubled: dict[str, Any] = {name: getattr(changed.motion, name) for name in _STATES}
        doubled = {name: np.concatenate([values, values[i : i + 1]]) for name, values in doubled.items()}
        contacts = [_renamed(c, i, new.id) if f <= c.frame < end else c for c in changed.motion.contacts]
        changed = replace(
            changed,
            objects=(*scene.objects, new),
            mass=np.append(scene.mass, scene.mass[i]),
            motion=BulletMotion(**doubled, contacts=tuple(contacts)),
            counterfactual={},
        )
        last = changed.motion.location_world.shape[1] if math.isinf(frames) else end
        replaced = np.zeros(changed.motion.location_world.shape[1], bool)
        replaced[f:last] = True
        changed = without(without(changed, [i], replaced), [new.id], ~replaced)
        words = differing_words(old.name.split(), new.name.split())
        return changed, world.violation("identity", [i, new.id], f, end, words, "words")
    return None


def _renamed(contact: Contact, old: int, new: int) -> Contact:
    a, b = sorted(new if i == old else i for i in contact.bodies)
    return replace(contact, bodies=(a, b))


def _continuity(world: _World, length: float, _: int) -> Change | None:
    """Shifted in any direction."""
    for i, f in world.moments():
        body = world.body(i, f)
        x, y = _turned(*body.location_world[:2], world.rng.uniform(0, 2 * math.pi), length)
        if world.has_space(i, f, x, y):
            scene = world.resumed(f, {i: replace(body, location_world=(x, y, body.location_world[2]))})
            if world.is_calm(scene, [i], f):
                return scene, world.violation("continuity", [i], f, f + 1, length, "world units")
    return None


def _inertia(world: _World, change: float, _: int) -> Change | None:
    """Another velocity."""
    for i, f in world.moments():
        body = world.body(i, f)
        vx, vy = _turned(*body.velocity[:2], world.rng.uniform(0, 2 * math.pi), change)
        scene = world.resumed(f, {i: replace(body, velocity=(vx, vy, body.velocity[2]))})
        if world.is_calm(scene, [i], f):
            return scene, world.violation("inertia", [i], f, f + 1, change, "world units/s")
    return None


def _friction(world: _World, deceleration: float, _: int) -> Change | None:
    """More friction on the ground."""
    gravity = world.simulator.config.gravity
    for i, f in world.moments(SLIDING_FRAMES, 2 * MOVING_SPEED):
        body = world.body(i, f)
        rough = replace(body, friction=GROUND_FRICTION[body.shape] + deceleration / gravity)
        scene, end = world.resumed(f, {i: rough}), world.scene.n_frames
        hits = [c.frame for c in scene.motion.contacts if i in c.bodies and c.frame > f]
        if min([end, *hits]) - f >= SLIDING_FRAMES:
            return scene, world.violation("friction", [i], f, end, deceleration, "world units/s²")
    return None


def _solidity(world: _World, distance: float, size: int) -> Change | None:
    """Two objects pass through each other."""
    least = [0.0, *AMOUNTS["solidity"]][size]
    for c in world.collisions():
        start = c.frame - BEFORE
        scene = world.resumed(start, {}, passing=c.bodies)
        i, j = c.bodies
        path = scene.motion.location_world[:, start : start + 3 * CALM_FRAMES, :2]
        gap = np.linalg.norm(path[i] - path[j], axis=-1)
        if least <= gap.min() < distance and world.is_calm(scene, c.bodies, start):
            inside = start + np.flatnonzero(gap < 2 * OBJECT_RADIUS_WORLD)
            if len(inside):
                found = world.violation(
                    "solidity", c.bodies, int(inside[0]), int(inside[-1]) + 1, gap.min(), "world units"
                )
                return scene, found
    return None


def _reaction(world: _World, restitution: float, size: int) -> Change | None:
    """Two objects rebound more than they can; or one of them as from a wall, while the other stays as it was."""
    for c in world.collisions():
        f, first = c.frame + 1, c.frame - 1
        before, now, after = ([world.body(i, at) for i in c.bodies] for at in (first, f, c.frame + AFTER))
        changes = [np.subtract(a.velocity, b.velocity) for a, b in zip(after, before, strict=True)]
        normal = changes[0] / max(float(np.linalg.norm(changes[0])), 1e-9)
        closing = float(np.subtract(before[1].velocity, before[0].velocity) @ normal)
        apart = float(np.subtract(after[0].velocity, after[1].velocity) @ normal)
        if closing < MIN_CLOSING_SPEED or apart < MIN_RESTITUTION * closing:
            continue
        wall = size == 0 and world.rng.random() < 0.5
        if wall:
            push, still = (closing + apart) * normal, np.zeros(3)
            pushes = [push, still] if world.rng.random() < 0.5 else [still, -push]
        else:
            pushes = [change * (1 + restitution) / (1 + apart / closing) for change in changes]
        # When they touch: both moved at the velocities before it, then at those after it.
        seconds, places = (f - first) * FRAME_SECONDS, [world.scene.motion.location_world[i, first] for i in c.bodies]
        late = [
            np.subtract(n.location_world, p) - seconds * np.asarray(a.velocity)
            for n, p, a in zip(now, places, after, strict=True)
        ]
        touch = -sum(float(d @ x) for d, x in zip(late, changes, strict=True)) / sum(float(x @ x) for x in changes)
        states: dict[int, Body | None] = {}
        for i, start, b, n, push in zip(c.bodies, places, before, now, pushes, strict=True):
            velocity = b.velocity + push
            place = start + min(max(touch, 0.0), seconds) * np.asarray(b.velocity) + (seconds - touch) * velocity
            x, y = place[:2].tolist()
            states[i] = replace(n, location_world=(x, y, n.location_world[2]), velocity=tuple(velocity.tolist()))
        scene = world.resumed(f, states)
        if world.is_calm(scene, c.bodies, f):
            amount, unit = (0.0, "share") if wall else (restitution, "restitution")
            return scene, world.violation("reaction", c.bodies, c.frame, c.frame + 1, amount, unit)
    return None


def _distance(world: _World, gap: float, _: int) -> Change | None:
    """Two objects repel each other as in their collision, before they touch."""
    motion = world.scene.motion
    for c in world.collisions():
        i, j = c.bodies
        at_contact = np.linalg.norm(np.subtract(*motion.location_world[[i, j], c.frame, :2]))
        separation = np.linalg.norm(motion.location_world[i, :, :2] - motion.location_world[j, :, :2], axis=-1)
        far = np.flatnonzero(separation[: c.frame] >= at_contact + gap)
        if not len(far) or c.frame - far[-1] > CALM_FRAMES:
            continue
        f, after = int(far[-1]), c.frame + AFTER
        changed: dict[int, Body | None] = {}
        for k in (i, j):
            state = world.body(k, after)
            changed[k] = replace(world.body(k, f), velocity=state.velocity, angular_velocity=state.angular_velocity)
        scene = world.resumed(f, changed)
        if world.is_calm(scene, c.bodies, f):
            return scene, world.violation("distance", c.bodies, f, f + 1, separation[f] - at_contact, "world units")
    return None


def _arrow(world: _World, number: float, size: int) -> Change | None:
    """The video backwards."""
    scene, n_frames, seen = world.scene, world.scene.n_frames, len(world.collisions())
    if seen < number or (size and seen > number):
        return None
    back: dict[str, Any] = {name: getattr(scene.motion, name)[:, :n_frames][:, ::-1].copy() for name in _STATES}
    back |= {name: -back[name] for name in _STATES[2:]}
    contacts = [replace(c, frame=n_frames - 1 - c.frame) for c in scene.motion.contacts if c.frame < n_frames]
    motion = BulletMotion(**back, contacts=tuple(reversed(contacts)))
    found = world.violation("arrow", [o.id for o in scene.objects], 0, n_frames, seen, "collisions")
    return replace(scene, motion=motion, counterfactual={}), found


def _standstill(world: _World, frames: float, _: int) -> Change | None:
    """The same picture for some frames while an object should move."""
    scene, total = world.scene, world.scene.motion.location_world.shape[1]
    more = int(frames) - 1
    for _i, f in world.moments(CALM_FRAMES, MOVING_SPEED):
        if f + more + CALM_FRAMES >= scene.n_frames:
            continue
        shown = np.concatenate([np.arange(f), np.full(more, f), np.arange(f, total - more)])
        states: dict[str, Any] = {name: getattr(scene.motion, name)[:, shown] for name in _STATES}
        contacts = [replace(c, frame=c.frame + more * (c.frame > f)) for c in scene.motion.contacts]
        motion = BulletMotion(**states, contacts=tuple(c for c in contacts if c.frame < total))
        found = world.violation("standstill", [o.id for o in scene.objects], f, f + int(frames), frames, "frames")
        return replace(scene, motion=motion, counterfactual={}), found
    return None


_BREAK: dict[str, Callable[[_World, float, int], Change | None]] = {
    "permanence": _permanence,
    "identity": _identity,
    "continuity": _continuity,
    "inertia": _inertia,
    "friction": _friction,
    "solidity": _solidity,
    "reaction": _reaction,
    "distance": _distance,
    "arrow": _arrow,
    "standstill": _standstill,
}
