"""CLEVRER's physics in Bullet, with the parameters recovered from its annotation files.

Objects are convex hulls on a plane. Spheres slide without friction, cubes and cylinders with a little. Only the start state
is random (positions, velocities, yaw of cubes, masses); the simulation is deterministic.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nsdr.generate.quiet import quiet
from nsdr.io.files import check_installed
from nsdr.validation import FloatArray, NotNegative, Settings, Share
from nsdr.world.physics_constants import (
    CONTACT_PAUSE_STEPS,
    GRAVITY,
    GROUND_FRICTION,
    GROUND_HALF_WIDTH_WORLD,
    GROUND_RESTITUTION,
    OBJECT_RADIUS_WORLD,
    OBJECT_RESTITUTION,
    SPINNING_FRICTION,
    STEP_SECONDS,
    STEPS_PER_FRAME,
)
from nsdr.world.shapes import hull_vertices

NEAR_WORLD = 6 * OBJECT_RADIUS_WORLD
"""Two objects whose centres are farther apart than this at the start of a frame are not checked for contact in that frame."""
GROUND_HALF_EXTENTS_WORLD = (GROUND_HALF_WIDTH_WORLD, GROUND_HALF_WIDTH_WORLD, 5.0)
"""Half-size of the box whose top face is the ground."""
GROUND_BOX_FRICTION = 1.0
"""Friction coefficient of the ground box. Bullet multiplies it by the object's coefficient."""
NORMAL_FORCE_FIELD, POINT_ON_A_FIELD = 9, 5
"""Fields of the rows that PyBullet's `getContactPoints` returns."""


@dataclass(frozen=True)
class BulletConfig(Settings):
    """Parameters of the simulation; the defaults are CLEVRER's.

    Attributes:
        gravity: downward acceleration (world units/s²).
        friction: friction coefficient of cubes and cylinders on the ground.
        sphere_friction: friction coefficient of spheres on the ground.
        restitution: restitution of each object; that of a collision is the product of the two.
    """

    gravity: NotNegative = GRAVITY
    friction: NotNegative = GROUND_FRICTION["cube"]
    sphere_friction: NotNegative = GROUND_FRICTION["sphere"]
    restitution: Share = OBJECT_RESTITUTION


@dataclass(frozen=True)
class Body:
    """An object at the start of a simulation.

    Attributes:
        shape: "cube", "sphere" or "cylinder".
        location_world: centre (x, y, z).
        orientation: Euler angles as in the annotation files (rad); a cylinder stands upright with (pi/2, 0, yaw).
        velocity: (x, y, z) (world units/s).
        angular_velocity: (x, y, z) (rad/s).
        mass: relative mass; only ratios matter.
        friction: friction coefficient on the ground; None for the usual one of the shape.
    """

    shape: str
    location_world: tuple[float, float, float]
    orientation: tuple[float, float, float]
    velocity: tuple[float, float, float]
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 1.0
    friction: float | None = None


@dataclass(frozen=True)
class Contact:
    """The start of a collision.

    Attributes:
        frame: frame nearest to the first contact.
        bodies: indices of the two bodies, in ascending order.
        location_world: point of contact (x, y, z).
    """

    frame: int
    bodies: tuple[int, int]
    location_world: tuple[float, float, float]


@dataclass(frozen=True)
class BulletMotion:
    """Result of a simulation. Arrays are (n_bodies, n_frames, 3), with the annotation files' conventions.

    Attributes:
        location_world: centres.
        orientation: Euler angles (rad).
        velocity: linear velocities (world units/s).
        angular_velocity: angular velocities (rad/s).
        contacts: collisions in order of time.
        complete: False if the simulation was stopped early; then the remaining frames are zero.
    """

    location_world: FloatArray
    orientation: FloatArray
    velocity: FloatArray
    angular_velocity: FloatArray
    contacts: tuple[Contact, ...] = field(default=())
    complete: bool = True

    def body(self, i: int, frame: int, shape: str, mass: float) -> Body:
        """The state of body i in a frame. Shape and mass are given, because a motion does not hold them."""
        states = (self.location_world, self.orientation, self.velocity, self.angular_velocity)
        location, orientation, velocity, spin = (tuple(state[i, frame].tolist()) for state in states)
        return Body(shape, location, orientation, velocity, spin, mass)


class Simulator:
    """A Bullet world for any number of simulations, one after another. Use it in a `with` block.

    Args:
        config: parameters of the simulation; None is CLEVRER's.

    Raises:
        DataError: PyBullet is not installed.
    """

    def __init__(self, config: BulletConfig | None = None) -> None:
        self.config = config or BulletConfig()
        check_installed("pybullet", "the simulator needs PyBullet", "generate")
        with quiet():  # PyBullet prints its build time
            import pybullet
        self._bullet: Any = pybullet
        self._client = self._bullet.connect(self._bullet.DIRECT)

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_: object) -> None:
        self._bullet.disconnect(self._client)

    def run(
        self,
        bodies: Sequence[Body],
        n_frames: int,
        stop: Callable[[list[Contact]], bool] | None = None,
        passing: tuple[int, int] | None = None,
    ) -> BulletMotion:
        """Simulate objects and record them at every frame.

        Args:
            bodies: start states, recorded as frame 0.
            n_frames: frames to record.
            stop: called with all contacts so far whenever a new one begins; the simulation stops if it returns True.
            passing: two bodies that pass through each other.
        """
        p, client = self._bullet, self._client
        numbers = self._build(bodies)
        if passing is not None:
            p.setCollisionFilterPair(*(numbers[i] for i in passing), -1, -1, 0, physicsClientId=client)
        states = np.zeros((4, len(bodies), n_frames, 3))
        recorded = states[0], states[1], states[2], states[3]
        contacts: list[Contact] = []
        last_touch: dict[tuple[int, int], int] = {}
        for frame in range(n_frames):
            if frame:
                location = states[0, :, frame - 1]
                gap = np.linalg.norm(location[:, None] - location[None], axis=-1)
                near = [(int(i), int(j)) for i, j in np.argwhere(gap < NEAR_WORLD) if i < j]
                for step in range((frame - 1) * STEPS_PER_FRAME + 1, frame * STEPS_PER_FRAME + 1):
                    p.stepSimulation(physicsClientId=client)
                    for pair in near:
                        point = self._touch(numbers[pair[0]], numbers[pair[1]])
                        if point is None:
                            continue
                        if step - last_touch.get(pair, -CONTACT_PAUSE_STEPS - 1) > CONTACT_PAUSE_STEPS:
                            contacts.append(Contact(int(step / STEPS_PER_FRAME + 0.5), pair, point))
                            if stop is not None and stop(contacts):
                                return BulletMotion(*recorded, tuple(contacts), complete=False)
                        last_touch[pair] = step
            for i, number in enumerate(numbers):
                position, quaternion = p.getBasePositionAndOrientation(number, physicsClientId=client)
                velocity, spin = p.getBaseVelocity(number, physicsClientId=client)
                states[:, i, frame] = position, p.getEulerFromQuaternion(quaternion), velocity, spin
        return BulletMotion(*recorded, tuple(contacts))

    def _touch(self, a: int, b: int) -> tuple[float, float, float] | None:
        """Point at which two bodies press on each other after the last step; None if they do not."""
        for point in self._bullet.getContactPoints(a, b, physicsClientId=self._client):
            if point[NORMAL_FORCE_FIELD] > 0:
                return tuple(point[POINT_ON_A_FIELD])
        return None

    def _build(self, bodies: Sequence[Body]) -> list[int]:
        # Never set contactBreakingThreshold: it is process-wide and outlives resetSimulation.
        p, client, config = self._bullet, self._client, self.config
        p.resetSimulation(physicsClientId=client)
        p.setGravity(0, 0, -config.gravity, physicsClientId=client)
        p.setTimeStep(STEP_SECONDS, physicsClientId=client)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=GROUND_HALF_EXTENTS_WORLD, physicsClientId=client)
        ground = p.createMultiBody(0, box, basePosition=[0, 0, -GROUND_HALF_EXTENTS_WORLD[2]], physicsClientId=client)
        surface = {"lateralFriction": GROUND_BOX_FRICTION, "restitution": GROUND_RESTITUTION}
        p.changeDynamics(ground, -1, **surface, physicsClientId=client)
        hulls = {
            shape: p.createCollisionShape(p.GEOM_MESH, vertices=hull_vertices(shape), physicsClientId=client)
            for shape in sorted({b.shape for b in bodies})
        }
        numbers = []
        for body in bodies:
            turned = p.getQuaternionFromEuler(body.orientation)
            hull, place = hulls[body.shape], {"basePosition": body.location_world, "baseOrientation": turned}
            number = p.createMultiBody(body.mass, hull, **place, physicsClientId=client)
            p.resetBaseVelocity(number, body.velocity, body.angular_velocity, physicsClientId=client)
            friction = config.sphere_friction if body.shape == "sphere" else config.friction
            surface = {
                "lateralFriction": friction if body.friction is None else body.friction,
                "restitution": config.restitution,
                "spinningFriction": SPINNING_FRICTION,
            }
            p.changeDynamics(number, -1, **surface, physicsClientId=client)
            numbers.append(number)
        return numbers
