"""A world's physics in Bullet; CLEVRER's parameters were recovered from its annotation files.

Objects are convex hulls on a plane. In CLEVRER, spheres slide without friction, cubes and cylinders with a little. Only the
start state is random (positions, velocities, yaw of boxes, masses); the simulation is deterministic.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nsdr.generate.quiet import quiet
from nsdr.io.files import check_installed
from nsdr.validation import FloatArray, NotNegative, Settings, Share
from nsdr.world.shapes import hull_vertices
from nsdr.world.world import CLEVRER_WORLD, World

NEAR, NEAR_SPEED = 3.0, 4.0
"""Two objects are not checked for contact in a frame if at its start their centres are farther apart than this multiple of the
sum of half their widths, and farther apart than their reach and the way at this multiple of the fastest start speed."""
GROUND_HALF_HEIGHT_WORLD = 5.0
"""Half of the height of the box whose top face is the ground."""
GROUND_BOX_FRICTION = 1.0
"""Friction coefficient of the ground box. Bullet multiplies it by the object's coefficient."""
DEFAULT_DAMPING = 0.04
"""Bullet's damping if none is set. It is not set where it is the same, because Bullet's own has the precision of 32 bits, which
CLEVRER's scenes depend on in their last decimals."""
NORMAL_FORCE_FIELD, POINT_ON_A_FIELD = 9, 5
"""Fields of the rows that PyBullet's `getContactPoints` returns."""


@dataclass(frozen=True)
class BulletConfig(Settings):
    """Parameters of the simulation that are not the world's. What is null (None in Python) is the world's.

    Attributes:
        gravity: downward acceleration (world units/s²).
        friction: friction coefficient of all objects but spheres on the ground.
        sphere_friction: friction coefficient of spheres on the ground.
        restitution: restitution of each object; that of a collision is the product of the two.
    """

    gravity: NotNegative | None = None
    friction: NotNegative | None = None
    sphere_friction: NotNegative | None = None
    restitution: Share | None = None

    def friction_of(self, world: World, shape: str, material: str) -> float:
        """Friction coefficient on the ground of objects of a shape and a material, by their words."""
        found = world.vocabulary.shape(shape)
        given = self.sphere_friction if found.solid == "sphere" else self.friction
        return found.friction * world.vocabulary.material(material).friction if given is None else given

    def gravity_of(self, world: World) -> float:
        """Downward acceleration (world units/s²)."""
        return world.physics.gravity if self.gravity is None else self.gravity


@dataclass(frozen=True)
class Body:
    """An object at the start of a simulation.

    Attributes:
        shape: the word of its shape.
        location_world: centre (x, y, z).
        orientation: Euler angles as in the annotation files (rad); a cylinder stands upright with (pi/2, 0, yaw).
        velocity: (x, y, z) (world units/s).
        angular_velocity: (x, y, z) (rad/s).
        mass: relative mass; only ratios matter.
        friction: friction coefficient on the ground; None for the usual one of the shape and material.
        material: the word of its material; None for the first one of the world.
    """

    shape: str
    location_world: tuple[float, float, float]
    orientation: tuple[float, float, float]
    velocity: tuple[float, float, float]
    angular_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 1.0
    friction: float | None = None
    material: str | None = None


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

    def body(self, i: int, frame: int, shape: str, mass: float, material: str | None = None) -> Body:
        """The state of body i in a frame. What a motion does not hold is given."""
        states = (self.location_world, self.orientation, self.velocity, self.angular_velocity)
        location, orientation, velocity, spin = (tuple(state[i, frame].tolist()) for state in states)
        return Body(shape, location, orientation, velocity, spin, mass, material=material)


class Simulator:
    """A Bullet world for any number of simulations, one after another. Use it in a `with` block.

    Args:
        config: parameters of the simulation; None is the world's.
        world: whose physics and shapes it has.

    Raises:
        DataError: PyBullet is not installed.
    """

    def __init__(self, config: BulletConfig | None = None, world: World = CLEVRER_WORLD) -> None:
        self.config, self.world = config or BulletConfig(), world
        self._hulls = {shape.word: hull_vertices(shape) for shape in world.vocabulary.shapes}
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
        p, client, per_frame = self._bullet, self._client, self.world.physics.steps_per_frame
        pause = self.world.physics.contact_pause_steps
        numbers, reach = self._build(bodies), self._near_world(bodies)
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
                near = [(int(i), int(j)) for i, j in np.argwhere(gap < reach) if i < j]
                for step in range((frame - 1) * per_frame + 1, frame * per_frame + 1):
                    p.stepSimulation(physicsClientId=client)
                    for pair in near:
                        point = self._touch(numbers[pair[0]], numbers[pair[1]])
                        if point is None:
                            continue
                        if step - last_touch.get(pair, -pause - 1) > pause:
                            contacts.append(Contact(int(step / per_frame + 0.5), pair, point))
                            if stop is not None and stop(contacts):
                                return BulletMotion(*recorded, tuple(contacts), complete=False)
                        last_touch[pair] = step
            for i, number in enumerate(numbers):
                position, quaternion = p.getBasePositionAndOrientation(number, physicsClientId=client)
                velocity, spin = p.getBaseVelocity(number, physicsClientId=client)
                states[:, i, frame] = position, p.getEulerFromQuaternion(quaternion), velocity, spin
        return BulletMotion(*recorded, tuple(contacts))

    def _near_world(self, bodies: Sequence[Body]) -> FloatArray:
        """(n, n) the distance of the centres up to which two bodies may touch within a frame."""
        physics = self.world.physics
        size = np.array([self.world.vocabulary.shape(body.shape).size_world for body in bodies])
        half, diagonal = size[:, :2].max(1) / 2, np.linalg.norm(size, axis=1) / 2
        moved = NEAR_SPEED * physics.start_speed_world_per_s[1] * physics.frame_seconds
        return np.maximum(NEAR * np.add.outer(half, half), np.add.outer(diagonal, diagonal) + moved)

    def _touch(self, a: int, b: int) -> tuple[float, float, float] | None:
        """Point at which two bodies press on each other after the last step; None if they do not."""
        for point in self._bullet.getContactPoints(a, b, physicsClientId=self._client):
            if point[NORMAL_FORCE_FIELD] > 0:
                return tuple(point[POINT_ON_A_FIELD])
        return None

    def _build(self, bodies: Sequence[Body]) -> list[int]:
        # Never set contactBreakingThreshold: it is process-wide and outlives resetSimulation.
        p, client, config, world = self._bullet, self._client, self.config, self.world
        physics, extents = world.physics, (*[world.physics.table_half_width_world] * 2, GROUND_HALF_HEIGHT_WORLD)
        p.resetSimulation(physicsClientId=client)
        p.setGravity(0, 0, -config.gravity_of(world), physicsClientId=client)
        p.setTimeStep(physics.step_seconds, physicsClientId=client)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=extents, physicsClientId=client)
        ground = p.createMultiBody(0, box, basePosition=[0, 0, -GROUND_HALF_HEIGHT_WORLD], physicsClientId=client)
        surface = {"lateralFriction": GROUND_BOX_FRICTION, "restitution": physics.table_restitution}
        p.changeDynamics(ground, -1, **surface, physicsClientId=client)
        hulls = {
            shape: p.createCollisionShape(p.GEOM_MESH, vertices=self._hulls[shape], physicsClientId=client)
            for shape in sorted({b.shape for b in bodies})
        }
        numbers = []
        for body in bodies:
            turned = p.getQuaternionFromEuler(body.orientation)
            hull, place = hulls[body.shape], {"basePosition": body.location_world, "baseOrientation": turned}
            number = p.createMultiBody(body.mass, hull, **place, physicsClientId=client)
            p.resetBaseVelocity(number, body.velocity, body.angular_velocity, physicsClientId=client)
            material = world.vocabulary.materials[0].word if body.material is None else body.material
            friction = config.friction_of(world, body.shape, material) if body.friction is None else body.friction
            restitution = config.restitution
            if restitution is None:
                restitution = world.vocabulary.material(material).restitution
            surface = {
                "lateralFriction": friction,
                "restitution": restitution,
                "spinningFriction": physics.spinning_friction,
            }
            dampings = {"linearDamping": physics.linear_damping, "angularDamping": physics.angular_damping}
            surface |= {name: value for name, value in dampings.items() if value != DEFAULT_DAMPING}
            p.changeDynamics(number, -1, **surface, physicsClientId=client)
            numbers.append(number)
        return numbers
