"""Events and violations in words, and what differs in a simulation."""

from collections.abc import Sequence

from nsdr.types import Event, EventChange, SceneObject, Simulation, Violation
from nsdr.types.answers import percent
from nsdr.types.events import VERBS
from nsdr.types.interventions import intervention_text


def event_text(event: Event, objects: Sequence[SceneObject]) -> str:
    """For example "the red metal cube and the blue rubber sphere collide"."""
    return VERBS[event.kind].format(*(f"the {objects[i].name}" for i in event.objects))


def interventions_text(simulation: Simulation) -> str:
    """For example "from frame 20: without the red metal cube"."""
    what = "; ".join(intervention_text(change) for change in simulation.interventions)
    return f"from frame {simulation.from_frame}: {what}"


def change_text(simulation: Simulation, change: EventChange) -> str:
    """For example "no longer: the red metal cube and the blue rubber sphere collide (frame 48, <1 %)"."""
    probable = "" if change.probability is None else f", {percent(change.probability)}"
    before = "" if change.kind != "other frame" else f" instead of {change.before}"
    happens = event_text(change.event, simulation.objects)
    return f"{change.kind}: {happens} (frame {change.event.frame}{before}{probable})"


AMOUNTS = {
    "permanence": "missing for {:.0f} frames",
    "identity": "attributes that differ: {:.0f}",
    "continuity": "a jump of {:.2f} world units",
    "inertia": "a change of velocity of {:.2f} world units/s",
    "friction": "a deceleration that differs by {:+.2f} world units/s²",
    "solidity": "{:.2f} world units from centre to centre",
    "reaction": "as if with a restitution of {:.2f}",
    "distance": "{:.2f} world units before they touch",
    "arrow": "backwards it fits better by {:.0f} nats",
    "standstill": "the same picture for {:.0f} frames",
}
"""What `Violation.amount` says, by law."""
OF_ALL = ("arrow", "standstill")
"""Laws that all objects break together."""


def violation_text(violation: Violation, objects: Sequence[SceneObject]) -> str:
    """For example "frame 43: identity, the red metal cube (was brown, is red; attributes that differ: 1, 98 %)"."""
    v, what = violation, AMOUNTS[violation.law].format(violation.amount)
    which = "all objects" if v.law in OF_ALL else " and ".join(f"the {objects[i].name}" for i in v.objects)
    if v.law == "standstill":
        what = f"time stands still from frame {v.frame} to {v.end - 1}"
    if v.looks:
        before, after = (look.split() for look in v.looks)
        was, now = (" ".join(w for w in look if w not in other) for look, other in ((before, after), (after, before)))
        what = f"was {was}, is {now}; {what}"
    return f"frame {v.frame}: {v.law}, {which} ({what}, {percent(v.probability)})"
