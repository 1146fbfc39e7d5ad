"""Changes of a scene at one frame: what `nsdr.Pipeline.simulate` takes.

Objects of the scene are named by words that only one of them has ("red cube", "red metal cube") or by id. Seconds are of
simulated time: a frame of CLEVRER is 0.028 s. Places and speeds are checked where the world is known
(`nsdr.dynamics.interventions`).
"""

from dataclasses import dataclass, fields
from typing import Annotated

from msgspec import Meta

from nsdr.validation import Checked, Finite, expect
from nsdr.world.vocabulary import Word, indefinite

Mass = Annotated[float, Meta(ge=0.001, le=1000)]
"""A mass, or the factor of one."""


@dataclass(frozen=True)
class Remove(Checked):
    """The object is not there from the frame on.

    Attributes:
        object: words or id.
    """

    object: str | int


@dataclass(frozen=True)
class SetMass(Checked):
    """The object weighs `factor` times as much. It moves as before until its next collision.

    Attributes:
        object: words or id.
        factor: of the mass that was fitted to the video, 0.001 to 1000.
    """

    object: str | int
    factor: Mass


@dataclass(frozen=True)
class SetVelocity(Checked):
    """The object has another velocity: `vx` and `vy`; or `speed`, `direction` or both; or `factor`.

    An object at rest has no direction to keep: `speed` alone and `factor` need one that moves. Speed 0 stops an object, which
    can then be pushed like any other (`Freeze` holds it).

    Attributes:
        object: words or id.
        vx, vy: velocity towards the camera, and to the right of the image (world units/s). CLEVRER's objects start with speeds
            of 2.7 to 3.
        speed: speed (world units/s), in CLEVRER up to 5; with `direction` None in the present direction.
        direction: degrees from the x axis (towards the camera) to the y axis (right of the image); with `speed` None at the
            present speed.
        factor: of the present velocity; a negative one reverses it.
    """

    object: str | int
    vx: Finite | None = None
    vy: Finite | None = None
    speed: Annotated[float, Meta(ge=0)] | None = None
    direction: Finite | None = None
    factor: Finite | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        by_axes, by_angle = self.vx is not None and self.vy is not None, (self.speed, self.direction) != (None, None)
        halves = (self.vx is None) != (self.vy is None)
        ways = by_axes + by_angle + (self.factor is not None)
        expected = "vx and vy, or speed and/or direction, or factor"
        expect(ways == 1 and not halves, "SetVelocity", expected, _given(self))


@dataclass(frozen=True)
class Move(Checked):
    """The object is at another position, with its velocity: `x` and `y`, or by `dx` and `dy` from where it is.

    Attributes:
        object: words or id.
        x, y: position on the ground: towards the camera, and to the right of the image (world units).
        dx, dy: shift along the same axes (world units).
    """

    object: str | int
    x: Finite | None = None
    y: Finite | None = None
    dx: Finite | None = None
    dy: Finite | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        given = [getattr(self, name) is not None for name in ("x", "y", "dx", "dy")]
        fits = given in ([True, True, False, False], [False, False, True, True])
        expect(fits, "Move", "x and y, or dx and dy", _given(self))


@dataclass(frozen=True)
class Freeze(Checked):
    """The object stops and is fixed to the ground: nothing that hits it moves it. `SetVelocity(…, speed=0)` only stops it.

    Attributes:
        object: words or id.
    """

    object: str | int


@dataclass(frozen=True)
class Add(Checked):
    """A new object.

    Attributes:
        color, material, shape: words of the world's vocabulary; no other object of the scene has all three.
        x, y: position on the ground: towards the camera, and to the right of the image (world units).
        vx, vy: velocity along the same axes (world units/s).
        yaw: rotation about the vertical axis, of boxes (radians).
        mass: relative mass; CLEVRER's objects have 0.7 to 1.3.
    """

    color: Word
    material: Word
    shape: Word
    x: Finite
    y: Finite
    vx: Finite = 0.0
    vy: Finite = 0.0
    yaw: Finite = 0.0
    mass: Mass = 1.0

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
        return f"with {indefinite(change.name)} at ({change.x:.3g}, {change.y:.3g}){moving}"
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


def _given(owner: Checked) -> str:
    names = [f.name for f in fields(owner) if f.name != "object"]
    return ", ".join(name for name in names if getattr(owner, name) is not None) or "none"
