"""Which laws of CLEVRER's world a video breaks."""

from dataclasses import dataclass
from typing import Annotated

from nsdr.types.answers import percent
from nsdr.types.tracks import SceneObject
from nsdr.validation import Checked, Count, PositiveCount, Share, expect, one_of

LAWS = {
    "permanence": "An object is there until it leaves at the border; none appears from nowhere.",
    "identity": "Color, material and shape stay as they are.",
    "continuity": "Objects do not jump.",
    "inertia": "Speed and direction change by contact and friction alone.",
    "friction": "Each shape slows down by its own law.",
    "solidity": "Objects do not pass through each other.",
    "reaction": "Of two objects that collide, both change, as masses and restitution allow.",
    "distance": "Nothing acts before it touches.",
    "arrow": "Time runs forwards.",
    "standstill": "Time does not stand still.",
}
"""What each law says. Violations are reported in this order."""
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


@dataclass(frozen=True)
class Violation(Checked):
    """One law broken in a video. `Judgement.describe` puts it in words.

    Attributes:
        law: one of `LAWS`.
        objects: ids of the objects that break it; all for "arrow" and "standstill".
        frame: the first frame that shows it.
        end: the first frame that no longer does; the video's end where it stays so.
        amount: how much is wrong, in `unit`.
        unit: "frames", "words", "world units", "world units/s", "world units/s²", "restitution"; in truth
            files also "share" and "collisions", in judgements also "nats".
        probability: that the law is broken; 1 in truth files.
        looks: of "identity", the words before and after the change; else empty.
    """

    law: Annotated[str, one_of(LAWS)]
    objects: tuple[Count, ...]
    frame: Count
    end: Count
    amount: float
    unit: str
    probability: Share = 1.0
    looks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judgement(Checked):
    """What a video breaks. Printed, it is the probability that a law is broken, and a line for each violation.

    Attributes:
        objects: what was seen.
        n_frames: number of frames of the video.
        violations: those that are more probable than not, in order of time.
        probability: that the video breaks any law.
        notes: what a user should know about the judgement, one sentence each: how the video differs from CLEVRER's.
    """

    objects: tuple[SceneObject, ...]
    n_frames: PositiveCount
    violations: tuple[Violation, ...]
    probability: Share
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        for v in self.violations:
            expect(max(v.objects) < len(self.objects), "Judgement.violations", "objects of the video", v.objects)

    def describe(self, violation: Violation) -> str:
        """For example "frame 43: identity, the red metal cube (was brown, is red; attributes that differ: 1, 98 %)"."""
        v, what = violation, AMOUNTS[violation.law].format(violation.amount)
        which = "all objects" if v.law in OF_ALL else " and ".join(f"the {self.objects[i].name}" for i in v.objects)
        if v.law == "standstill":
            what = f"time stands still from frame {v.frame} to {v.end - 1}"
        if v.looks:
            before, after = (look.split() for look in v.looks)
            was, now = (" ".join(w for w in a if w not in b) for a, b in ((before, after), (after, before)))
            what = f"was {was}, is {now}; {what}"
        return f"frame {v.frame}: {v.law}, {which} ({what}, {percent(v.probability)})"

    def __str__(self) -> str:
        head = f"probability that a law is broken: {percent(self.probability)}"
        return "\n".join([head, *(f"  {self.describe(v)}" for v in self.violations)])
