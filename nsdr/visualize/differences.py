"""What differs in a simulation, in words."""

from nsdr.types import Event, EventChange, Simulation
from nsdr.types.interventions import intervention_text

__all__ = ["change_text", "interventions_text", "percent"]


def interventions_text(simulation: Simulation) -> str:
    """For example "from frame 20: without the red metal cube"."""
    what = "; ".join(intervention_text(change) for change in simulation.interventions)
    return f"from frame {simulation.from_frame}: {what}"


def change_text(simulation: Simulation, change: EventChange) -> str:
    """For example "no longer: the red metal cube and the blue rubber sphere collide (frame 48, <1 %)"."""
    probable = "" if change.probability is None else f", {percent(change.probability)}"
    before = "" if change.kind != "other frame" else f" instead of {change.before}"
    return f"{change.kind}: {_sentence(simulation, change.event)} (frame {change.event.frame}{before}{probable})"


def percent(probability: float) -> str:
    """A probability (0-1) as "77 %", never as certainty."""
    rounded = round(100 * probability)
    return f"{'>99' if rounded == 100 else '<1' if rounded == 0 else rounded} %"


def _sentence(s: Simulation, event: Event) -> str:
    names = [f"the {s.objects[i].name}" for i in event.objects]
    return {"in": "{} enters", "out": "{} exits", "collision": "{} and {} collide"}[event.kind].format(*names)
