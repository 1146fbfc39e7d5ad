"""What really happens in a generated video if one object is changed: Bullet starts again from the states in the truth file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from nsdr.dynamics.interventions import check_speed
from nsdr.errors import DataError
from nsdr.generate.physics.bullet import Body, Simulator
from nsdr.generate.physics.disturbed import bodies_of, states_at
from nsdr.io.worlds import world_in
from nsdr.types import Event, SetMass, SetVelocity
from nsdr.types.interventions import Intervention
from nsdr.world.world import World


class TruthSimulator:
    """The collisions in a generated video after one object is changed; implements `nsdr.symbolic.quantities.Simulate`.

    States in truth files are rounded. Therefore the unchanged video is simulated again, too; if that does not give its true
    collisions, the effect of a change is not known either.

    Args:
        truth: content of a truth file, of a scene with its world's physics.
    """

    def __init__(self, truth: Mapping[str, Any]) -> None:
        self.objects: Sequence[Mapping[str, Any]] = sorted(truth["objects"], key=lambda o: int(o["object_id"]))
        self.truth, self.world = truth, world_in(truth)
        self.collisions = [
            Event("collision", c["frame_id"], tuple(sorted(c["object_ids"]))) for c in truth["collisions"]
        ]

    def __call__(self, change: Intervention, from_frame: int) -> list[Event]:
        """The first collision of each pair, in order of time.

        Args:
            change: a `SetMass` by its factor, or a `SetVelocity` by its factor or to 0, of an object by its id.
            from_frame: frame of the change.

        Raises:
            DataError: another intervention, one that is impossible, or a video whose simulation does not repeat its truth.
        """
        states = states_at(self.truth, from_frame)
        bodies = bodies_of([o["shape"] for o in self.objects], states, [o["material"] for o in self.objects])
        if not isinstance(change, SetMass | SetVelocity) or not isinstance(change.object, int):
            raise DataError(f"{change!r:.80}: expected a SetMass or SetVelocity of an object by its id")
        changed = list(bodies)
        changed[change.object] = _changed(bodies[change.object], change, self.world)
        with Simulator(world=self.world) as simulator:
            same, found = (self._simulated(simulator, start, from_frame) for start in (bodies, changed))
        if {e.objects for e in same} != {e.objects for e in self.collisions}:
            raise DataError(
                "the video simulated again does not have its own collisions, so changes of it are not known"
            )
        return found

    def _simulated(self, simulator: Simulator, bodies: Sequence[Body], from_frame: int) -> list[Event]:
        first: dict[tuple[int, ...], Event] = {}
        for event in self.collisions:
            if event.frame <= from_frame:
                first.setdefault(event.objects, event)
        for contact in simulator.run(bodies, len(self.truth["frames"]) - from_frame).contacts:
            first.setdefault(contact.bodies, Event("collision", contact.frame + from_frame, contact.bodies))
        return sorted(first.values(), key=lambda e: e.frame)


def _changed(body: Body, change: SetMass | SetVelocity, world: World) -> Body:
    if isinstance(change, SetMass):
        return replace(body, mass=body.mass * change.factor)
    vx, vy, vz = body.velocity
    speed = math.hypot(vx, vy)
    if change.factor is None:
        if change.vx or change.vy or change.vx is None:
            raise DataError(f"{change!r:.80}: expected a factor, or vx=0 and vy=0")
        return replace(body, velocity=(0.0, 0.0, vz))
    if speed < world.physics.moving_speed_world_per_s:
        raise DataError("the object rests, so it has no speed to multiply")
    check_speed("SetVelocity", speed * abs(change.factor), world)
    return replace(body, velocity=(change.factor * vx, change.factor * vy, vz))
