"""Scenes that break exactly one law of their world, made from lawful ones.

A scene is changed at one frame, and Bullet goes on from there: apart from that one change, everything is lawful.
"""

import math
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from nsdr.generate.physics.bullet import Body, BulletMotion, Contact, Simulator
from nsdr.generate.physics.lawful_scene import CALM_FRAMES, STATES, LawfulScene, without
from nsdr.generate.physics.scene import SimulatedScene
from nsdr.types import SceneObject, Violation
from nsdr.world.vocabulary import NAMES, differing_words
from nsdr.world.world import World

SIZES = ("clear", "small", "limit")
"""How easily a violation is seen, from easy to hard. "limit" is the limit of what positions known to 0.003 world units show in
CLEVRER."""
AMOUNTS = {
    "permanence": (math.inf, 16, 6),
    "identity": (math.inf, 40, 10),
    "continuity": (0.4, 0.1, 0.03),
    "inertia": (1.0, 0.3, 0.1),
    "friction": (1.2, 0.5, 0.15),
    "solidity": (0.1, 0.2, 0.32),
    "reaction": (1.26, 0.66, 0.26),
    "distance": (0.4, 0.2, 0.08),
    "arrow": (2, 1, 0),
    "standstill": (15, 8, 5),
}
"""By law, for each of `SIZES`, in CLEVRER; `amount_in` says how other worlds differ:

- permanence: number of frames in which an object is missing
- identity: number of frames in which it has other attributes (all three if clear, else its colour; where the vocabulary has no
  other word of a kind, as many as can differ)
- continuity: how far it jumps (world units)
- inertia: change of its velocity (world units/s)
- friction: additional deceleration (world units/s²)
- solidity: largest value of the least distance between two centres while one object passes through the other (world units)
- reaction: by how much the restitution is larger than the lawful one; in half of the clear cases, one of the two objects does
  not react at all instead
- distance: gap at which two objects repel each other (world units)
- arrow: number of well visible collisions in the video, which is played backwards
- standstill: number of identical frames"""
SCALES = {
    "permanence": "rate",
    "identity": "rate",
    "continuity": "size",
    "inertia": "speed",
    "friction": "gravity",
    "solidity": "size",
    "distance": "size",
    "standstill": "rate",
}
"""The field of `World.scales` to which a law's amounts are in proportion; those of other laws are the same everywhere."""
SLIDING_FRAMES = 40
"""Frames after a change of friction in which the object is in clear view and touches nothing: friction takes time to show."""
MOVING_SPEED = 0.5
"""Least speed of objects that are missing for a time or stand still; objects whose friction changes are at least twice as fast
(world units/s in CLEVRER)."""
MIN_CLOSING_SPEED, MIN_RESTITUTION_SHARE = 0.5, 0.625
"""Least speed of approach in collisions whose effect is changed (world units/s in CLEVRER), and least restitution that they
show, as a share of the lawful one: less is shown by objects that touch with a corner or spin."""
BEFORE, AFTER = 2, 3
"""Frames before and after a collision at which velocities are those before and after it."""

BrokenScene = tuple[SimulatedScene, Violation]
"""A scene with a broken law, and what was done."""


def break_law(scene: SimulatedScene, law: str, size: str, seed: int) -> BrokenScene | None:
    """The scene with a law broken once, and what was done; None if the scene gives no occasion.

    An object whose attributes change is represented by two objects, of which the second takes the place of the first. Absent
    objects are behind the camera.

    Args:
        scene: a lawful scene with its world's physics.
        law: one of `nsdr.types.LAWS`.
        size: one of `SIZES`.
        seed: of the random choices.
    """
    with Simulator(world=scene.world) as simulator:
        lawful = LawfulScene(scene, simulator, random.Random(seed))
        return _BREAK[law](lawful, amount_in(scene.world, law, size), SIZES.index(size))


def amount_in(world: World, law: str, size: str) -> float:
    """How much a law is broken in a world, in the units of `AMOUNTS`.

    Args:
        world: of the scenes.
        law: one of `nsdr.types.LAWS`.
        size: one of `SIZES`.
    """
    scale: float = getattr(world.scales, SCALES[law]) if law in SCALES else 1.0
    amount = AMOUNTS[law][SIZES.index(size)] * scale
    return max(round(amount), 1) if SCALES.get(law) == "rate" and math.isfinite(amount) else amount


def _turned(x: float, y: float, angle: float, length: float) -> tuple[float, float]:
    return x + length * math.cos(angle), y + length * math.sin(angle)


def _permanence(lawful: LawfulScene, frames: float, size: int) -> BrokenScene | None:
    """An object vanishes, appears out of nothing, or is missing for some frames."""
    least_speed = MOVING_SPEED * lawful.scene.world.scales.speed * (size > 0)
    for i, f in lawful.moments(CALM_FRAMES + (0 if math.isinf(frames) else int(frames)), least_speed):
        if math.isinf(frames) and lawful.rng.random() < 0.5:
            if any(i in c.bodies and c.frame <= f for c in lawful.scene.motion.contacts):
                continue
            scene, start, end = without(lawful.scene, [i], slice(f)), 0, f
            return scene, lawful.violation("permanence", [i], end, end, end, "frames")
        if math.isinf(frames):
            scene, start, end = lawful.resumed(f, {i: None}), f, lawful.scene.n_frames
        else:
            start, end = f, f + int(frames)
            scene = without(lawful.scene, [i], slice(start, end))
        return scene, lawful.violation("permanence", [i], start, end, end - start, "frames")
    return None


def _identity(lawful: LawfulScene, frames: float, size: int) -> BrokenScene | None:
    """Another object takes an object's place: with other attributes altogether, or another colour."""
    scene, rng, vocabulary = lawful.scene, lawful.rng, lawful.scene.world.vocabulary
    names = {o.name for o in scene.objects}
    for i, f in lawful.moments(CALM_FRAMES + (0 if math.isinf(frames) else int(frames))):
        old = scene.objects[i]
        words = {kind: getattr(old, kind) for kind in NAMES}
        for kind in NAMES if size == 0 else NAMES[:1]:
            others = [word for word in vocabulary.words[kind] if word != words[kind]]
            words[kind] = rng.choice(others) if others else words[kind]
        new = SceneObject(len(scene.objects), **words)
        if new.name in names:
            continue
        end, changed = scene.n_frames if math.isinf(frames) else f + int(frames), scene
        if size == 0:
            shape = vocabulary.shape(new.shape)
            x, y, z = lawful.body(i, f).location_world
            place = x, y, z + shape.height_world - lawful.shapes[i].height_world
            turned = (math.pi / 2 if shape.solid == "cylinder" else 0.0, 0.0, 0.0)
            body = replace(lawful.body(i, f), shape=new.shape, material=new.material, location_world=place)
            changed = lawful.resumed(f, {i: replace(body, orientation=turned, angular_velocity=(0.0,) * 3)})
        doubled: dict[str, Any] = {name: getattr(changed.motion, name) for name in STATES}
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
        differing = differing_words(old.name.split(), new.name.split())
        return changed, lawful.violation("identity", [i, new.id], f, end, differing, "words")
    return None


def _renamed(contact: Contact, old: int, new: int) -> Contact:
    a, b = sorted(new if i == old else i for i in contact.bodies)
    return replace(contact, bodies=(a, b))


def _continuity(lawful: LawfulScene, length: float, _: int) -> BrokenScene | None:
    """An object jumps in a random direction."""
    for i, f in lawful.moments():
        body = lawful.body(i, f)
        x, y = _turned(*body.location_world[:2], lawful.rng.uniform(0, 2 * math.pi), length)
        if lawful.has_space(i, f, x, y):
            scene = lawful.resumed(f, {i: replace(body, location_world=(x, y, body.location_world[2]))})
            if lawful.is_calm(scene, [i], f):
                return scene, lawful.violation("continuity", [i], f, f + 1, length, "world units")
    return None


def _inertia(lawful: LawfulScene, change: float, _: int) -> BrokenScene | None:
    """An object's velocity changes in a random direction."""
    for i, f in lawful.moments():
        body = lawful.body(i, f)
        vx, vy = _turned(*body.velocity[:2], lawful.rng.uniform(0, 2 * math.pi), change)
        scene = lawful.resumed(f, {i: replace(body, velocity=(vx, vy, body.velocity[2]))})
        if lawful.is_calm(scene, [i], f):
            return scene, lawful.violation("inertia", [i], f, f + 1, change, "world units/s")
    return None


def _friction(lawful: LawfulScene, deceleration: float, _: int) -> BrokenScene | None:
    """The ground brakes an object more than it can."""
    world = lawful.scene.world
    for i, f in lawful.moments(SLIDING_FRAMES, 2 * MOVING_SPEED * world.scales.speed):
        body, material = lawful.body(i, f), world.vocabulary.material(lawful.scene.objects[i].material)
        usual = lawful.shapes[i].friction * material.friction
        rough = replace(body, friction=usual + deceleration / world.physics.gravity)
        scene, end = lawful.resumed(f, {i: rough}), lawful.scene.n_frames
        hits = [c.frame for c in scene.motion.contacts if i in c.bodies and c.frame > f]
        if min([end, *hits]) - f >= SLIDING_FRAMES:
            return scene, lawful.violation("friction", [i], f, end, deceleration, "world units/s²")
    return None


def _solidity(lawful: LawfulScene, distance: float, size: int) -> BrokenScene | None:
    """Two objects pass through each other."""
    least = 0.0 if size == 0 else amount_in(lawful.scene.world, "solidity", SIZES[size - 1])
    for c in lawful.collisions():
        start = c.frame - BEFORE
        scene = lawful.resumed(start, {}, passing=c.bodies)
        i, j = c.bodies
        path = scene.motion.location_world[:, start : start + 3 * CALM_FRAMES, :2]
        gap = np.linalg.norm(path[i] - path[j], axis=-1)
        if least <= gap.min() < distance and lawful.is_calm(scene, c.bodies, start):
            inside = start + np.flatnonzero(gap < lawful.shapes[i].half_width_world + lawful.shapes[j].half_width_world)
            if len(inside):
                found = lawful.violation(
                    "solidity", c.bodies, int(inside[0]), int(inside[-1]) + 1, gap.min(), "world units"
                )
                return scene, found
    return None


def _reaction(lawful: LawfulScene, excess: float, size: int) -> BrokenScene | None:
    """Two objects rebound faster than they can; or one rebounds as if from a wall, while the other moves on unchanged."""
    world = lawful.scene.world
    least_speed = MIN_CLOSING_SPEED * world.scales.speed
    for c in lawful.collisions():
        usual = world.vocabulary.pair_restitution(*(lawful.scene.objects[i].material for i in c.bodies))
        f, first = c.frame + 1, c.frame - 1
        before, now, after = ([lawful.body(i, at) for i in c.bodies] for at in (first, f, c.frame + AFTER))
        changes = [np.subtract(a.velocity, b.velocity) for a, b in zip(after, before, strict=True)]
        normal = changes[0] / max(float(np.linalg.norm(changes[0])), 1e-9)
        closing = float(np.subtract(before[1].velocity, before[0].velocity) @ normal)
        apart = float(np.subtract(after[0].velocity, after[1].velocity) @ normal)
        if closing < least_speed or apart < MIN_RESTITUTION_SHARE * usual * closing:
            continue
        wall = size == 0 and lawful.rng.random() < 0.5
        if wall:
            push, still = (closing + apart) * normal, np.zeros(3)
            pushes = [push, still] if lawful.rng.random() < 0.5 else [still, -push]
        else:
            pushes = [change * (1 + usual + excess) / (1 + apart / closing) for change in changes]
        # When they touch: both moved at the velocities before it, then at those after it.
        seconds = (f - first) * world.physics.frame_seconds
        places = [lawful.scene.motion.location_world[i, first] for i in c.bodies]
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
        scene = lawful.resumed(f, states)
        if lawful.is_calm(scene, c.bodies, f):
            amount, unit = (0.0, "share") if wall else (usual + excess, "restitution")
            return scene, lawful.violation("reaction", c.bodies, c.frame, c.frame + 1, amount, unit)
    return None


def _distance(lawful: LawfulScene, gap: float, _: int) -> BrokenScene | None:
    """Two objects repel each other as in a collision, but before they touch."""
    motion = lawful.scene.motion
    for c in lawful.collisions():
        i, j = c.bodies
        at_contact = np.linalg.norm(np.subtract(*motion.location_world[[i, j], c.frame, :2]))
        separation = np.linalg.norm(motion.location_world[i, :, :2] - motion.location_world[j, :, :2], axis=-1)
        far = np.flatnonzero(separation[: c.frame] >= at_contact + gap)
        if not len(far) or c.frame - far[-1] > CALM_FRAMES:
            continue
        f, after = int(far[-1]), c.frame + AFTER
        changed: dict[int, Body | None] = {}
        for k in (i, j):
            state = lawful.body(k, after)
            changed[k] = replace(lawful.body(k, f), velocity=state.velocity, angular_velocity=state.angular_velocity)
        scene = lawful.resumed(f, changed)
        if lawful.is_calm(scene, c.bodies, f):
            return scene, lawful.violation("distance", c.bodies, f, f + 1, separation[f] - at_contact, "world units")
    return None


def _arrow(lawful: LawfulScene, number: float, size: int) -> BrokenScene | None:
    """The video is played backwards."""
    scene, n_frames, seen = lawful.scene, lawful.scene.n_frames, len(lawful.collisions())
    if seen < number or (size and seen > number):
        return None
    back: dict[str, Any] = {name: getattr(scene.motion, name)[:, :n_frames][:, ::-1].copy() for name in STATES}
    back |= {name: -back[name] for name in STATES[2:]}
    contacts = [replace(c, frame=n_frames - 1 - c.frame) for c in scene.motion.contacts if c.frame < n_frames]
    motion = BulletMotion(**back, contacts=tuple(reversed(contacts)))
    found = lawful.violation("arrow", [o.id for o in scene.objects], 0, n_frames, seen, "collisions")
    return replace(scene, motion=motion, counterfactual={}), found


def _standstill(lawful: LawfulScene, frames: float, _: int) -> BrokenScene | None:
    """The picture stands still for some frames, although an object should move."""
    scene, total = lawful.scene, lawful.scene.motion.location_world.shape[1]
    more = int(frames) - 1
    for _i, f in lawful.moments(CALM_FRAMES, MOVING_SPEED * scene.world.scales.speed):
        if f + more + CALM_FRAMES >= scene.n_frames:
            continue
        shown = np.concatenate([np.arange(f), np.full(more, f), np.arange(f, total - more)])
        states: dict[str, Any] = {name: getattr(scene.motion, name)[:, shown] for name in STATES}
        contacts = [replace(c, frame=c.frame + more * (c.frame > f)) for c in scene.motion.contacts]
        motion = BulletMotion(**states, contacts=tuple(c for c in contacts if c.frame < total))
        found = lawful.violation("standstill", [o.id for o in scene.objects], f, f + int(frames), frames, "frames")
        return replace(scene, motion=motion, counterfactual={}), found
    return None


_BREAK: dict[str, Callable[[LawfulScene, float, int], BrokenScene | None]] = {
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
