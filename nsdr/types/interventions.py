"""Changes of a scene at one frame: what `nsdr.Pipeline.simulate` takes.

Objects of the scene are named by words that only one of them has ("red cube", "red metal cube") or by id. Seconds are of
simulated time: a frame is 0.028 s.
"""

import math
from dataclasses import dataclass, fields
from numbers import Real

from nsdr.types.checks import check
from nsdr.types.tracks import SceneObject
from nsdr.world.physics_constants import GROUND_HALF_WIDTH_WORLD, OBJECT_RADIUS_WORLD

__all__ = ["Add", "Freeze", "Intervention", "Move", "Remove", "SetMass", "SetVelocity", "intervention_text"]

MAX_SPEED_WORLD_PER_S = 5.0
"""Fastest speed that can be set (world units/s): CLEVRER's objects start with up to 3, and at 5 one crosses a tenth of another
one within two steps of the simulation."""
MASS_FACTORS = (0.001, 1000.0)
"""Smallest and largest factor of a mass."""
MAX_POSITION_WORLD = GROUND_HALF_WIDTH_WORLD - OBJECT_RADIUS_WORLD
"""Largest coordinate of an object on the ground (world units)."""


@dataclass(frozen=True)
class Remove:
    """The object is not there from the frame on.

    Attributes:
        object: words or id.
    """

    object: str | int


@dataclass(frozen=True)
class SetMass:
    """The object weighs `factor` times as much. It moves as before until its next collision.

    Attributes:
        object: words or id.
        factor: of the mass that was fitted to the video, 0.001 to 1000.
    """

    object: str | int
    factor: float

    def __post_init__(self) -> None:
        _numbers(self, "factor")
        low, high = MASS_FACTORS
        check(low <= self.factor <= high, f"SetMass.factor: expected {low:g} to {high:g}, got {self.factor:g}")


@dataclass(frozen=True)
class SetVelocity:
    """The object has another velocity: `vx` and `vy`; or `speed`, `direction` or both; or `factor`.

    An object at rest has no direction to keep: `speed` alone and `factor` need one that moves. Speed 0 stops an object, which
    can then be pushed like any other (`Freeze` holds it).

    Attributes:
        object: words or id.
        vx, vy: velocity towards the camera, and to the right of the image (world units/s). CLEVRER's objects start with speeds
            of 2.7 to 3.
        speed: speed (world units/s), up to 5; with `direction` None in the present direction.
        direction: degrees from the x axis (towards the camera) to the y axis (right of the image); with `speed` None at the
            present speed.
        factor: of the present velocity; a negative one reverses it.
    """

    object: str | int
    vx: float | None = None
    vy: float | None = None
    speed: float | None = None
    direction: float | None = None
    factor: float | None = None

    def __post_init__(self) -> None:
        _numbers(self, "vx", "vy", "speed", "direction", "factor", optional=True)
        by_axes, by_angle = self.vx is not None and self.vy is not None, (self.speed, self.direction) != (None, None)
        halves = (self.vx is None) != (self.vy is None)
        ways = by_axes + by_angle + (self.factor is not None)
        expected = "vx and vy, or speed and/or direction, or factor"
        check(ways == 1 and not halves, f"SetVelocity: expected {expected}, got {_given(self)}")
        check(self.speed is None or self.speed >= 0, f"SetVelocity.speed: expected 0 or more, got {self.speed}")
        fastest = max(self.speed or 0.0, math.hypot(self.vx or 0.0, self.vy or 0.0))
        check_speed("SetVelocity", fastest)


@dataclass(frozen=True)
class Move:
    """The object is at another position, with its velocity: `x` and `y`, or by `dx` and `dy` from where it is.

    Attributes:
        object: words or id.
        x, y: position on the ground: towards the camera, and to the right of the image (world units).
        dx, dy: shift along the same axes (world units).
    """

    object: str | int
    x: float | None = None
    y: float | None = None
    dx: float | None = None
    dy: float | None = None

    def __post_init__(self) -> None:
        _numbers(self, "x", "y", "dx", "dy", optional=True)
        given = [getattr(self, name) is not None for name in ("x", "y", "dx", "dy")]
        fits = given in ([True, True, False, False], [False, False, True, True])
        check(fits, f"Move: expected x and y, or dx and dy, got {_given(self)}")
        if self.x is not None and self.y is not None:
            check_position("Move", self.x, self.y)
        farthest = max(abs(self.dx or 0.0), abs(self.dy or 0.0))
        check(
            farthest <= 2 * MAX_POSITION_WORLD,
            f"Move: expected dx and dy of up to {2 * MAX_POSITION_WORLD:g}, the width of the ground, got {farthest:.3g}",
        )


@dataclass(frozen=True)
class Freeze:
    """The object stops and is fixed to the ground: nothing that hits it moves it. `SetVelocity(…, speed=0)` only stops it.

    Attributes:
        object: words or id.
    """

    object: str | int


@dataclass(frozen=True)
class Add:
    """A new object.

    Attributes:
        color, material, shape: words of `nsdr.world.vocabulary`; no other object of the scene has all three.
        x, y: position on the ground: towards the camera, and to the right of the image (world units).
        vx, vy: velocity along the same axes (world units/s).
        yaw: rotation about the vertical axis, of cubes (radians).
        mass: relative mass; CLEVRER's objects have 0.7 to 1.3.
    """

    color: str
    material: str
    shape: str
    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0
    yaw: float = 0.0
    mass: float = 1.0

    def __post_init__(self) -> None:
        _numbers(self, "x", "y", "vx", "vy", "yaw", "mass")
        SceneObject(0, self.color, self.material, self.shape)  # checks the words
        check_position("Add", self.x, self.y)
        check_speed("Add", math.hypot(self.vx, self.vy))
        low, high = MASS_FACTORS
        check(low <= self.mass <= high, f"Add.mass: expected {low:g} to {high:g}, got {self.mass:g}")

    @property
    def name(self) -> str:
        """For example "red rubber cube"."""
        return f"{self.color} {self.material} {self.shape}"


Intervention = Remove | SetMass | SetVelocity | Move | Freeze | Add
"""Any change of a scene."""


def intervention_text(change: Intervention) -> str:
    """The change as a phrase: "without the red cube", "the blue sphere 2 times as heavy"."""
    if isinstance(change, Add):
        moving = f", velocity ({change.vx:g}, {change.vy:g})" if change.vx or change.vy else ""
        return f"with a {change.name} at ({change.x:.3g}, {change.y:.3g}){moving}"
    name = f"the {change.object}" if isinstance(change.object, str) else f"object {change.object}"
    if isinstance(change, Remove):
        return f"without {name}"
    if isinstance(change, SetMass):
        return f"{name} {change.factor:g} times as heavy"
    if isinstance(change, Freeze):
        return f"{name} fixed to the ground"
    if isinstance(change, Move):
        if change.x is None:
            return f"{name} moved by ({change.dx:g}, {change.dy:g})"
        return f"{name} at ({change.x:g}, {change.y:g})"
    if change.factor is not None:
        return f"{name} {change.factor:g} times as fast"
    if change.vx is not None:
        return f"{name} with velocity ({change.vx:g}, {change.vy:g})"
    speed = "" if change.speed is None else f" with speed {change.speed:g}"
    return f"{name}{speed}" + ("" if change.direction is None else f" in direction {change.direction:g}°")


def check_speed(owner: str, speed: float) -> None:
    """Raise `DataError` for a speed (world units/s) beyond `MAX_SPEED_WORLD_PER_S`."""
    most = MAX_SPEED_WORLD_PER_S
    check(speed <= most, f"{owner}: expected a speed of up to {most:g} world units per second, got {speed:.3g}")


def check_position(owner: str, x: float, y: float) -> None:
    """Raise `DataError` for a position (world units) that is not on the ground."""
    most = MAX_POSITION_WORLD
    on_ground = max(abs(x), abs(y)) <= most
    check(on_ground, f"{owner}: expected a position on the ground, from {-most:g} to {most:g}, got ({x:.3g}, {y:.3g})")


def _numbers(owner: object, *names: str, optional: bool = False) -> None:
    """Make the named attributes floats; an `optional` None stays. Raises `DataError` where one is no finite number."""
    for name in names:
        value = getattr(owner, name)
        if value is None and optional:
            continue
        is_number = isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
        check(is_number, f"{type(owner).__name__}.{name}: expected a finite number, got {value!r:.60}")
        object.__setattr__(owner, name, float(value))


def _given(owner: object) -> str:
    names = [f.name for f in fields(owner) if f.name != "object"]  # type: ignore[arg-type]
    return ", ".join(name for name in names if getattr(owner, name) is not None) or "none"
