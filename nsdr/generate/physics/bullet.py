"""CLEVRER's physics in Bullet, with the parameters recovered from its annotation files.

One frame is 7 steps of 0.004 s. Objects are convex hulls on a plane; spheres slide without friction, cubes and cylinders
with a little. Nothing but the start (positions, velocities, turn of cubes, masses) is random.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.generate.quiet import quiet
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.shapes import hull_vertices

__all__ = ["Body", "BulletConfig", "BulletMotion", "Contact", "Simulator"]

FloatArray = NDArray[np.floating[Any]]
NEAR_WORLD = 6 * OBJECT_RADIUS_WORLD
"""Centres farther apart at a frame's start cannot touch within that frame."""
CONTACT_PAUSE_STEPS = 70
"""Two objects that touch again after that many steps apart have collided again."""


@dataclass(frozen=True)
class BulletConfig:
    """Parameters of the simulation; the defaults are CLEVRER's.

    Attributes:
        step_s: Bullet's time step in seconds.
        steps_per_frame: steps between two frames.
        gravity: world units per second squared, downwards.
        friction: of cubes and cylinders on the ground.
        sphere_friction: of spheres on the ground.
        spinning_friction: torsional, of all objects.
        restitution: of each object; two objects rebound with the product.
        ground_restitution: of the ground.
    """

    step_s: float = 0.004
    steps_per_frame: int = 7
    gravity: float = 9.81
    friction: float = 0.03
    sphere_friction: float = 0.0
    spinning_friction: float = 0.01
    restitution: float = 0.8
    ground_restitution: float = 0.5


@dataclass(frozen=True)
class Body:
    """An object at the start of a simulation.

    Attributes:
        shape: "cube", "sphere" or "cylinder".
        location_world: (x, y, z).
        orientation: Euler angles in radians as annotated; a cylinder stands upright with (pi/2, 0, yaw).
        velocity: world units per second.
        angular_velocity: radians per second.
        mass: relative; only ratios matter.
    """

    shape: str
    location_world: tuple[float, float, float]
    orientation: tuple[float, float, float]
    velocity: tuple[float, float, float]
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 1.0


@dataclass(frozen=True)
class Contact:
    """The start of a collision: frame, indices of the two bodies, and where they touch (x, y, z)."""

    frame: int
    bodies: tuple[int, int]
    location_world: tuple[float, float, float]


@dataclass(frozen=True)
class BulletMotion:
    """What a simulation gives: arrays (n_bodies, n_frames, 3) as in the annotation files, and collisions in order of time.

    `complete` is False when the run was stopped before its end; later frames are zero.
    """

    location_world: FloatArray
    orientation: FloatArray
    velocity: FloatArray
    angular_velocity: FloatArray
    contacts: tuple[Contact, ...] = field(default=())
    complete: bool = True


class Simulator:
    """A Bullet world for many simulations one after another. Use it in a `with` block.

    Raises:
        DataError: PyBullet is not installed.
    """

    def __init__(self, config: BulletConfig | None = None) -> None:
        self.config = config or BulletConfig()
        self._bullet = _pybullet()
        self._client = self._bullet.connect(self._bullet.DIRECT)

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_: object) -> None:
        self._bullet.disconnect(self._client)

    def run(
        self, bodies: Sequence[Body], n_frames: int, stop: Callable[[list[Contact]], bool] | None = None
    ) -> BulletMotion:
        """Simulate from frame 0, the start, on.

        Args:
            bodies: the objects.
            n_frames: frames to record.
            stop: called with all contacts so far whenever there is a new one; True ends the run early.
        """
        p, client, config = self._bullet, self._client, self.config
        numbers = self._build(bodies)
        states = np.zeros((4, len(bodies), n_frames, 3))
        contacts: list[Contact] = []
        last_touch: dict[tuple[int, int], int] = {}
        for frame in range(n_frames):
            if frame:
                location = states[0, :, frame - 1]
                gap = np.linalg.norm(location[:, None] - location[None], axis=-1)
                near = [(int(i), int(j)) for i, j in np.argwhere(gap < NEAR_WORLD) if i < j]
                for step in range((frame - 1) * config.steps_per_frame + 1, frame * config.steps_per_frame + 1):
                    p.stepSimulation(physicsClientId=client)
                    for pair in near:
                        position = self._touch(numbers[pair[0]], numbers[pair[1]])
                        if position is None:
                            continue
                        if step - last_touch.get(pair, -CONTACT_PAUSE_STEPS - 1) > CONTACT_PAUSE_STEPS:
                            contacts.append(Contact(int(step / config.steps_per_frame + 0.5), pair, position))
                            if stop is not None and stop(contacts):
                                return _motion(states, contacts, complete=False)
                        last_touch[pair] = step
            for i, number in enumerate(numbers):
                position, quaternion = p.getBasePositionAndOrientation(number, physicsClientId=client)
                velocity, spin = p.getBaseVelocity(number, physicsClientId=client)
                states[:, i, frame] = position, p.getEulerFromQuaternion(quaternion), velocity, spin
        return _motion(states, contacts)

    def _touch(self, a: int, b: int) -> tuple[float, float, float] | None:
        """Where two bodies press on each other after the last step."""
        for point in self._bullet.getContactPoints(a, b, physicsClientId=self._client):
            if point[9] > 0:  # normal force
                return tuple(point[5])
        return None

    def _build(self, bodies: Sequence[Body]) -> list[int]:
        # Never set contactBreakingThreshold: it is process-wide and outlives resetSimulation.
        p, client, config = self._bullet, self._client, self.config
        p.resetSimulation(physicsClientId=client)
        p.setGravity(0, 0, -config.gravity, physicsClientId=client)
        p.setTimeStep(config.step_s, physicsClientId=client)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[15, 15, 5], physicsClientId=client)
        ground = p.createMultiBody(0, box, basePosition=[0, 0, -5], physicsClientId=client)
        p.changeDynamics(ground, -1, lateralFriction=1.0, restitution=config.ground_restitution, physicsClientId=client)
        hulls = {
            shape: p.createCollisionShape(p.GEOM_MESH, vertices=hull_vertices(shape), physicsClientId=client)
            for shape in sorted({b.shape for b in bodies})
        }
        numbers = []
        for body in bodies:
            turn = p.getQuaternionFromEuler(body.orientation)
            number = p.createMultiBody(
                body.mass,
                hulls[body.shape],
                basePosition=body.location_world,
                baseOrientation=turn,
                physicsClientId=client,
            )
            p.resetBaseVelocity(number, body.velocity, body.angular_velocity, physicsClientId=client)
            p.changeDynamics(
                number,
                -1,
                lateralFriction=config.sphere_friction if body.shape == "sphere" else config.friction,
                restitution=config.restitution,
                spinningFriction=config.spinning_friction,
                physicsClientId=client,
            )
            numbers.append(number)
        return numbers


def _motion(states: FloatArray, contacts: list[Contact], complete: bool = True) -> BulletMotion:
    location, orientation, velocity, spin = states
    return BulletMotion(location, orientation, velocity, spin, tuple(contacts), complete)


def _pybullet() -> Any:
    try:
        with quiet():  # it prints its build time
            import pybullet
    except ImportError as e:
        raise DataError("the simulator needs PyBullet: pip install 'nsdr[generate]'") from e
    return pybullet
