"""Where in a scene a law can be broken visibly, and how the scene goes on after a change."""

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nsdr.generate.physics.bullet import Body, Contact, Simulator
from nsdr.generate.physics.scene import SimulatedScene
from nsdr.tracking.visibility import cut_sides, hidden_sides, in_image
from nsdr.types import Violation
from nsdr.validation import BoolArray
from nsdr.world.shapes import surface_points

CALM_FRAMES = 12
"""Number of frames before and after a change in which the changed objects are fully in view and touch nothing."""
SEEN_SHARE = 0.5
"""Least share of the frames around a collision in which no part of either object is hidden."""
SPACE = 1.6
"""Least distance between the centre of an object that jumps or appears and the centre of any other, in sums of half widths."""
AWAY_WORLD = 50.0
"""Absent objects are put so far behind the camera (world units)."""
STATES = ("location_world", "orientation", "velocity", "angular_velocity")
"""The arrays of a `BulletMotion`."""


@dataclass
class LawfulScene:
    """A lawful scene, what is visible in it, and how it goes on after a change.

    Attributes:
        scene: the scene, with its world's physics.
        simulator: runs it on after a change.
        rng: makes the random choices.
        whole: (n, F) bool, whether an object is in the image and not cut off by its border.
        unhidden: (n, F) bool, whether it is in the image and nothing hides it.
        clear: (n, F) bool, whether nothing hides it and it touches nothing in the neighbouring frames.
    """

    scene: SimulatedScene
    simulator: Simulator
    rng: random.Random

    def __post_init__(self) -> None:
        motion, n_frames, camera = self.scene.motion, self.scene.n_frames, self.scene.world.camera
        self.shapes = [self.scene.world.vocabulary.shape(o.shape) for o in self.scene.objects]
        boxes = np.full((len(self.scene.objects), n_frames, 4), np.nan)
        for o in self.scene.objects:
            location, yaw = motion.location_world[o.id, :n_frames], motion.orientation[o.id, :n_frames, 2]
            shape = self.shapes[o.id]
            for f in np.flatnonzero(in_image(shape, location, yaw, camera)):
                outline = camera.pixels(surface_points(shape, float(yaw[f])) + location[f])
                boxes[o.id, f] = *outline.min(0), *outline.max(0)
        seen = np.isfinite(boxes).all(-1)
        self.whole: BoolArray = seen & ~cut_sides(boxes, camera).any(-1)
        self.unhidden: BoolArray = seen & ~hidden_sides(boxes.transpose(1, 0, 2), camera).any(-1).T
        self.clear = self.unhidden.copy()
        for contact in motion.contacts:
            start = max(contact.frame - CALM_FRAMES, 0)
            for i in contact.bodies:
                self.clear[i, start : contact.frame + CALM_FRAMES // 2] = False

    def moments(self, frames: int = CALM_FRAMES, speed: float = 0.0) -> list[tuple[int, int]]:
        """Pairs (object, frame), in random order: the object is at least as fast as `speed`, in clear view and touches nothing,
        and the latter two stay so for `frames` frames."""
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
        """Collisions, in random order, of objects that are well visible and touch nothing else in the frames around."""
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
        o = self.scene.objects[i]
        return self.scene.motion.body(i, frame, o.shape, float(self.scene.mass[i]), o.material)

    def resumed(
        self, frame: int, changed: dict[int, Body | None], passing: tuple[int, int] | None = None
    ) -> SimulatedScene:
        """The scene as it goes on if some objects have other states, or are removed, from a frame on.

        Args:
            frame: of the change.
            changed: the new states in that frame, by object id; None removes the object.
            passing: two objects that pass through each other.
        """
        motion, total = self.scene.motion, self.scene.motion.location_world.shape[1]
        bodies = {o.id: changed.get(o.id, self.body(o.id, frame)) for o in self.scene.objects}
        there = [i for i, body in bodies.items() if body is not None]
        through = None if passing is None else (there.index(passing[0]), there.index(passing[1]))
        run = self.simulator.run([b for b in bodies.values() if b is not None], total - frame, passing=through)
        states: dict[str, Any] = {name: getattr(motion, name).copy() for name in STATES}
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
        """Whether objects stay in the image and touch nothing new in the frames after a change."""
        last, motion, world = frame + CALM_FRAMES, scene.motion, scene.world
        for i in objects:
            if any(i in c.bodies and frame <= c.frame <= last for c in motion.contacts):
                return False
            shown = slice(frame, last + 1)
            path, yaw = motion.location_world[i, shown], motion.orientation[i, shown, 2]
            if not in_image(world.vocabulary.shape(scene.objects[i].shape), path, yaw, world.camera).all():
                return False
        return True

    def has_space(self, i: int, frame: int, x: float, y: float) -> bool:
        """Whether an object fits at a place."""
        others = np.delete(self.scene.motion.location_world[:, frame, :2], i, axis=0)
        half = np.array([shape.half_width_world for shape in self.shapes])
        space = SPACE * (half[i] + np.delete(half, i))
        return bool((np.linalg.norm(others - np.array([x, y]), axis=1) > space).all())

    def violation(self, law: str, objects: Sequence[int], start: int, end: int, amount: float, unit: str) -> Violation:
        """The record of a broken law; its frames end with the video."""
        return Violation(law, tuple(objects), start, min(end, self.scene.n_frames), round(float(amount), 4), unit)


def without(scene: SimulatedScene, objects: Sequence[int], frames: slice | BoolArray) -> SimulatedScene:
    """The scene with objects moved behind the camera in the given frames: a slice, or (T,) bool."""
    location = scene.motion.location_world.copy()
    eye, target = np.array(scene.world.camera.eye_world), np.array(scene.world.camera.target_world)
    location[list(objects), frames] = eye + AWAY_WORLD * (eye - target) / np.linalg.norm(eye - target)
    return replace(scene, motion=replace(scene.motion, location_world=location))
