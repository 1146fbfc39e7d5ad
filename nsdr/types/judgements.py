"""Which laws of CLEVRER's world a video breaks."""

from dataclasses import dataclass
from typing import Annotated

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


@dataclass(frozen=True)
class Violation(Checked):
    """One law broken in a video.

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
    """What a video breaks.

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
