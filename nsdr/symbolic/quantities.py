"""Speeds, directions and masses of a scene's objects, and what happens if one is changed.

What is not known about the scene, or not with enough confidence, raises an `ExecutionError`. Nothing is guessed.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError, ExecutionError
from nsdr.types import Event, Scene, SetMass, SetVelocity
from nsdr.types.events import SAME_EVENT_FRAMES
from nsdr.types.interventions import Intervention, intervention_text
from nsdr.world.vocabulary import DIRECTIONS, STATIONARY

Simulate = Callable[[Intervention, int], Sequence[Event]]
"""(intervention, frame) -> events of the video, and after it, with this intervention at this frame.

Raises `DataError` if the intervention is impossible."""
Extreme = Callable[..., int]
"""`max` or `min`."""

CHANGES: Mapping[str, Callable[[int], Intervention]] = {
    "twice_as_heavy": lambda i: SetMass(i, factor=2.0),
    "half_as_heavy": lambda i: SetMass(i, factor=0.5),
    "twice_as_fast": lambda i: SetVelocity(i, factor=2.0),
    "half_as_fast": lambda i: SetVelocity(i, factor=0.5),
    "standing_still": lambda i: SetVelocity(i, vx=0.0, vy=0.0),
}
"""Changes of an object. Masses are changed from the start, velocities at the first frame at which the object is visible."""
MOTION_ERROR_PX = 2.0
"""Assumed standard deviation of each component of `Scene.motion_px` (pixels). Of 188 objects of 40 videos of training
seeds, 68 % have errors up to 0.5 and 95 % up to 6, where an object is first or last seen at another frame
(`python -m benchmarks.extensions DATA DATA/derender_proposals --errors`)."""
CLEAR_DEGREES = 30.0
"""The largest angle between a motion and a direction that describes it (degrees)."""
SURE = 1.645
"""Differences count as real if they exceed this many standard deviations. 95 % of a normal distribution lies below."""


class Quantities:
    """Numbers of one scene.

    Args:
        scene: the scene.
        simulate: gives the collisions with an intervention; None if the scene cannot be simulated.
    """

    def __init__(self, scene: Scene, simulate: Simulate | None = None) -> None:
        self._scene, self._simulate = scene, simulate
        self._changed: dict[tuple[int, str], tuple[Event, ...]] = {}

    def speed(self, i: int, frame: int | None) -> float:
        """Speed of an object at a frame (world units/s)."""
        return math.hypot(*self._velocity(i, frame))

    def direction(self, i: int, frame: int | None) -> str:
        """One of `nsdr.world.vocabulary.DIRECTIONS`."""
        vx, vy = self._velocity(i, frame)
        speed, error, world = math.hypot(vx, vy), self._speed_error, self._scene.world
        if speed <= world.physics.moving_speed_world_per_s + SURE * error:
            raise ExecutionError(f"the {self._name(i)} hardly moves at frame {frame}, so it has no direction")
        angle = (math.degrees(math.atan2(vy, vx)) - world.camera.azimuth_degrees) % 360
        nearest = round(angle / 90) % 4
        off = abs((angle - 90 * nearest + 180) % 360 - 180)
        if off + math.degrees(SURE * error / speed) > CLEAR_DEGREES:
            quarter = int(angle // 90) % 4  # a tiny negative angle modulo 360 is 360
            between = f"{DIRECTIONS[quarter]} and {DIRECTIONS[(quarter + 1) % 4]}"
            raise ExecutionError(f"the {self._name(i)} moves between {between} at frame {frame}: no single direction")
        return DIRECTIONS[nearest]

    def image_directions(self, i: int) -> dict[str, float]:
        """Where an object moves in the image over the whole video: the words of `IMAGE_DIRECTIONS` with their probabilities, or
        `STATIONARY` for an object that never moves. Only the first and the last visible position count, not the path.
        """
        motion, moving, name = self._scene.motion_px, self._scene.moving, self._name(i)
        if motion is None or moving is None:
            raise ExecutionError(f"where the {name} moves in the image is not known in this scene; ask about a video")
        if not self._scene.visible[i].any():
            raise ExecutionError(f"the {name} is never visible")
        if not (moving[i] & self._scene.visible[i]).any():
            return {STATIONARY: 1.0}
        if np.isnan(motion[i]).any():
            raise ExecutionError(f"where the {name} moves in the image is not known")
        right, down = (NormalDist(0.0, MOTION_ERROR_PX).cdf(float(component)) for component in motion[i])
        across, along = {"left": 1 - right, "right": right}, {"up": 1 - down, "down": down}
        return {f"{a} and to the {b}": p * q for a, p in along.items() for b, q in across.items()}

    def image_direction(self, i: int) -> str:
        """The most probable of `image_directions`."""
        found = self.image_directions(i)
        return max(found, key=lambda word: found[word])

    def faster(self, i: int, j: int, frame: int | None) -> int:
        """The faster of two objects at a frame. If it is None, their highest speeds while they are visible are compared."""
        self._check_two(i, j)
        a, b = self._speed_of(i, frame), self._speed_of(j, frame)
        self._check_speeds(i, j, a, b)
        return i if a > b else j

    def extreme_speed(self, objects: Sequence[int], frame: int | None, extreme: Extreme) -> tuple[int, ...]:
        """The fastest (`max`) or slowest (`min`) of the objects that are visible at a frame, or at any frame if it is None.

        Empty if no object is visible.
        """
        visible = self._scene.visible if frame is None else self._scene.visible[:, [self._in_video(frame)]]
        speeds = {i: self._speed_of(i, frame) for i in objects if visible[i].any()}
        if not speeds:
            return ()
        found = extreme(speeds, key=lambda i: speeds[i])
        for i, speed in speeds.items():
            if i != found:
                self._check_speeds(found, i, speeds[found], speed)
        return (found,)

    def heavier(self, i: int, j: int) -> int:
        """The heavier of two objects."""
        self._check_two(i, j)
        return i if self._mass_difference(i, j) > 0 else j

    def extreme_mass(self, objects: Sequence[int], extreme: Extreme) -> tuple[int, ...]:
        """The heaviest (`max`) or lightest (`min`) of the objects; empty if there are none."""
        if not objects:
            return ()
        log_mass = self._masses[0]
        found = extreme(objects, key=lambda i: float(log_mass[i]))
        for i in objects:
            if i != found:
                self._mass_difference(found, i)
        return (found,)

    def events_with(self, i: int, change: str) -> tuple[Event, ...]:
        """The events of the video, and after it, with an object changed (see `CHANGES`)."""
        if (i, change) not in self._changed:
            self._changed[i, change] = self._simulated(i, CHANGES[change](i))
        return self._changed[i, change]

    def _simulated(self, i: int, intervention: Intervention) -> tuple[Event, ...]:
        if self._simulate is None:
            text = intervention_text(intervention).replace(f"object {i}", f"the {self._name(i)}")
            raise ExecutionError(
                f"what happens with {text} is not known in this scene; ask about the video, which can be simulated"
            )
        start = 0
        if isinstance(intervention, SetVelocity):
            if not self._scene.visible[i].any():
                raise ExecutionError(f"the {self._name(i)} is never visible, so its speed cannot be changed")
            start = int(np.argmax(self._scene.visible[i]))
        try:
            return tuple(self._simulate(intervention, start))
        except DataError as e:
            raise ExecutionError(str(e)) from e

    def _velocity(self, i: int, frame: int | None) -> tuple[float, float]:
        """Velocity of an object at a frame. The error says why it is not known."""
        velocity, name = self._velocities, self._name(i)
        if frame is None:
            raise ExecutionError(f"the speed of the {name} changes; ask for a time, such as 'when the video begins'")
        if not self._scene.visible[i, self._in_video(frame)]:
            raise ExecutionError(f"the {name} is not in the image at frame {frame}")
        near = [hit for hit in self._collision_frames(i) if abs(hit - frame) <= SAME_EVENT_FRAMES]
        if near:
            where = f"at frame {near[0]}, where its velocity changes"
            raise ExecutionError(f"the {name} collides {where}; ask for another time than frame {frame}")
        if np.isnan(velocity[i, frame]).any():
            raise ExecutionError(f"the velocity of the {name} at frame {frame} is not known")
        vx, vy = velocity[i, frame].tolist()
        return vx, vy

    def _speed_of(self, i: int, frame: int | None) -> float:
        """Speed at a frame. If it is None, the highest speed while the object is visible."""
        if frame is not None:
            return self.speed(i, frame)
        speed = np.linalg.norm(self._velocities[i, self._scene.visible[i]], axis=-1)
        if not len(speed) or np.isnan(speed).any():
            raise ExecutionError(f"the velocity of the {self._name(i)} is not known at all times")
        return float(speed.max())

    def _check_speeds(self, i: int, j: int, a: float, b: float) -> None:
        if abs(a - b) <= SURE * math.sqrt(2) * self._speed_error:
            what = f"the {self._name(i)} ({a:.2f}) and the {self._name(j)} ({b:.2f} world units per second)"
            raise ExecutionError(f"{what} are about equally fast: the difference is within the error of measurement")

    def _mass_difference(self, i: int, j: int) -> float:
        """Difference of log masses. It is an error if the difference is within its own error."""
        log_mass, covariance = self._masses
        difference = float(log_mass[i] - log_mass[j])
        error = math.sqrt(max(float(covariance[i, i] + covariance[j, j] - 2 * covariance[i, j]), 0.0))
        if abs(difference) <= SURE * error:
            unmet = [k for k in (i, j) if not self._collision_frames(k)]
            why = f"the {self._name(unmet[0])} collides with nothing" if unmet else "their collisions do not tell"
            names = f"the {self._name(i)} or the {self._name(j)}"
            raise ExecutionError(f"whether {names} is heavier is not known: {why if error else 'they weigh the same'}")
        return difference

    def _collision_frames(self, i: int) -> list[int]:
        return [e.frame for e in self._scene.events if e.kind == "collision" and i in e.objects]

    @property
    def _velocities(self) -> NDArray[np.floating[Any]]:
        if self._scene.physics is None:
            raise ExecutionError("velocities are not known in this scene; the dynamics backend physics measures them")
        return self._scene.physics.velocity_world_per_s

    @property
    def _speed_error(self) -> float:
        return 0.0 if self._scene.physics is None else self._scene.physics.velocity_error_world_per_s

    @property
    def _masses(self) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]]]:
        physics = self._scene.physics
        if physics is None or physics.log_mass is None or physics.log_mass_covariance is None:
            raise ExecutionError("masses are not known in this scene; the dynamics backend physics fits them")
        return physics.log_mass, physics.log_mass_covariance

    def _check_two(self, i: int, j: int) -> None:
        if i == j:
            raise ExecutionError(f"both are the {self._name(i)}; compare two objects")

    def _in_video(self, frame: int) -> int:
        last = self._scene.n_frames - 1
        if frame > last:
            raise ExecutionError(f"frame {frame} is after the video; velocities are known in frames 0 to {last}")
        return frame

    def _name(self, i: int) -> str:
        return self._scene.objects[i].name
