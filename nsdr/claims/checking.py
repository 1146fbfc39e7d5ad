"""Checks whether statements hold in a scene."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nsdr.claims.statements import PAST_KINDS, EventPhrase, ObjectPhrase, Statement
from nsdr.symbolic.causal import causal_path
from nsdr.types import Event, Scene
from nsdr.world.vocabulary import NAMES, indefinite


@dataclass(frozen=True)
class Verdict:
    """Whether a statement holds.

    Attributes:
        holds: True or False; None if that cannot be said.
        reason: why it does not hold, or why that cannot be said; "" if it holds.
        objects: ids of the objects that the statement names, as far as they are known.
        event: the event of the scene that the statement is about, if it holds and is about one. For a cause, it is the effect.
    """

    holds: bool | None
    reason: str = ""
    objects: tuple[int, ...] = ()
    event: Event | None = None


class _Undecided(Exception):
    """Raised for a noun phrase that no object fits (`holds` is False), and for what cannot be said (`holds` is None)."""

    def __init__(self, holds: bool | None, reason: str) -> None:
        super().__init__(reason)
        self.holds, self.reason = holds, reason


class StatementChecker:
    """Compares statements with one scene, which counts as the truth.

    Args:
        scene: the scene.
        tolerance_frames: the largest difference between a stated frame and the scene's.
    """

    def __init__(self, scene: Scene, tolerance_frames: int) -> None:
        self.scene, self.tolerance = scene, tolerance_frames
        self._methods = {
            "order": self._order,
            "cause": self._cause,
            "attribute": self._attribute,
            "presence": self._presence,
            "motion": self._motion,
            "count": self._count,
        }

    def check(self, said: Statement) -> Verdict:
        """Whether a statement holds."""
        removed = [said.removed] if said.removed else []
        phrases = [*said.objects, *(p for e in said.events for p in e.objects), *removed]
        try:
            classes = said.objects[:1] if said.number is not None or said.kind == "presence" else ()
            objects: list[int] = []
            for phrase in phrases:
                if phrase not in classes:
                    found = self._meant(phrase)
                    if said.negated and not phrase.definite:
                        raise _Undecided(
                            None, f"'{phrase.text}' in a denied sentence may mean any or a particular object"
                        )
                    objects += found if len(found) == 1 else []
            verdict = self._methods.get(said.kind, self._happens)(said)
        except _Undecided as e:
            fitting = [self._fitting(p) for p in phrases if p.known]
            objects = [found[0] for found in fitting if len(found) == 1]
            # What is denied of an object that does not exist is neither right nor wrong.
            verdict = Verdict(None if said.negated else e.holds, e.reason)
        reason = "" if verdict.holds else verdict.reason
        return replace(verdict, reason=reason, objects=tuple(dict.fromkeys(objects)))

    # Objects.

    def _fitting(self, phrase: ObjectPhrase) -> list[int]:
        return [o.id for o in self.scene.objects if {o.color, o.material, o.shape}.issuperset(phrase.words)]

    def _meant(self, phrase: ObjectPhrase) -> list[int]:
        """The object that a definite phrase stands for, or all that an indefinite one may stand for."""
        if not phrase.known:
            raise _Undecided(None, f"'{phrase.text}' does not say which object is meant")
        found = self._fitting(phrase)
        if not found:
            raise _Undecided(False, f"no object of the video fits '{phrase.text}'")
        if phrase.definite and len(found) > 1:
            raise _Undecided(None, f"'{phrase.text}' fits {len(found)} objects")
        return found

    def _one(self, phrase: ObjectPhrase) -> int:
        found = self._meant(replace(phrase, definite=True))
        return found[0]

    # Events.

    def _matching(self, phrase: EventPhrase, events: Iterable[Event]) -> list[Event]:
        """Events of the kind and objects, at any frame."""
        return [e for e in events if e.kind == phrase.kind and self._fits(phrase, e.objects)]

    def _fits(self, phrase: EventPhrase, objects: tuple[int, ...]) -> bool:
        meant = [self._meant(p) for p in phrase.objects]
        if len(meant) < 2:
            return not meant or any(i in meant[0] for i in objects)
        first, second = meant
        if first == second and len(first) == 1:
            raise _Undecided(False, "both names fit the same object")
        i, j = objects
        return (i in first and j in second) or (j in first and i in second)

    def _near(self, phrase: EventPhrase) -> list[Event]:
        """Observed events of the kind and objects, and of the frame where one is stated."""
        return self._at(phrase.frame, self._matching(phrase, self.scene.events))

    def _at(self, frame: int | None, events: Iterable[Event]) -> list[Event]:
        """The events within the tolerance of a frame; all with None."""
        return [e for e in events if frame is None or abs(e.frame - frame) <= self.tolerance]

    def _sides(self, said: Statement, events: list[Event]) -> list[list[Event]]:
        """The events before or after the stated frame, for each boundary within the tolerance; all without such a frame."""
        if not said.relation or said.frame is None:
            return [events]
        frames = range(said.frame - self.tolerance, said.frame + self.tolerance + 1)
        return [[e for e in events if (e.frame > f if said.relation == "after" else e.frame < f)] for f in frames]

    def _course(self, said: Statement) -> Sequence[Event]:
        """Events of the course of events that a statement is about."""
        if said.kind in PAST_KINDS.values():
            return self.scene.events
        if said.removed:
            when, only = f"without {said.removed.text}", "without an object"
            known = (self.scene.counterfactual or {}).get(self._one(said.removed))
        else:
            when, only, known = "after the video", "after the video", self.scene.predicted
        if known is None:
            raise _Undecided(None, f"events {when} are not known in this scene")
        if said.events[0].kind != "collision" and self.scene.collisions_only:
            raise _Undecided(None, f"only collisions are known {only}")
        return known

    def _happens(self, said: Statement) -> Verdict:
        (phrase,) = said.events
        matching = self._matching(phrase, self._course(said))
        if said.number is not None:
            return Verdict(len(matching) == said.number, f"there are {len(matching)}")
        frames = " and ".join(str(e.frame) for e in matching)
        happens = f"it happens at frame {frames}" if matching else "it does not happen"
        if said.relation:
            sides = self._sides(said, matching)
            found = max(sides, key=len)
            return Verdict([] in sides if said.negated else bool(found), happens, event=found[0] if found else None)
        near = self._at(phrase.frame, matching)
        if not said.negated:
            elsewhere = f"{happens}, not at frame {phrase.frame}" if matching else happens
            return Verdict(bool(near), elsewhere, event=near[0] if near else None)
        if near and phrase.frame is not None and phrase.frame not in [e.frame for e in near]:
            return Verdict(None, f"{happens}, which is within the tolerance")
        return Verdict(not near, happens)

    # Order and causes.

    def _order(self, said: Statement) -> Verdict:
        if said.number is not None:
            return self._place(said, said.number - 1 if said.number > 0 else -1)
        first, second = (self._near(p) for p in said.events)
        if not first or not second:
            return Verdict(False, "one of the events does not happen")
        sign = 1 if said.relation == "after" else -1
        answers = {(a.frame - b.frame) * sign > 0 for a in first for b in second}
        if len(answers) > 1:
            return Verdict(None, "an event happens more than once")
        return Verdict(answers.pop(), f"the first is at frame {first[0].frame}, the second at frame {second[0].frame}")

    def _place(self, said: Statement, index: int) -> Verdict:
        (phrase,) = said.events
        events = [e for e in self.scene.events if e.kind == phrase.kind]
        if not said.objects:  # the first collision is of two objects
            if not -len(events) <= index < len(events):
                return Verdict(False, f"there are {len(events)} collisions")
            return Verdict(self._fits(phrase, events[index].objects), f"that one is at frame {events[index].frame}")
        members, filler = self._fitting(said.objects[0]), self._one(said.objects[1])
        partner = self._one(phrase.objects[0]) if phrase.objects else None
        taking_part = [e for e in events if partner is None or partner in e.objects]
        row = [(e.frame, next(i for i in e.objects if i != partner)) for e in taking_part]
        row = [(frame, i) for frame, i in row if i in members]
        if not -len(row) <= index < len(row):
            return Verdict(False, "there is none" if index < 0 else f"there are {len(row)}")
        frame, found = row[index]
        return Verdict(found == filler, f"it is the {self.scene.objects[found].name}, at frame {frame}")

    def _cause(self, said: Statement) -> Verdict:
        *before, effect = said.events
        effects = self._near(effect)
        causes = [self._near(phrase) for phrase in before]
        if not effects or not all(causes):
            return Verdict(None if said.negated else False, "one of the events does not happen")
        responsible = set(self._meant(said.objects[0])) if said.objects else set()

        def led_to(event: Event) -> bool:
            def starts(e: Event) -> bool:
                return (e in causes[0] and e != event) if before else bool(responsible.intersection(e.objects))

            return causal_path(self.scene.events, starts, event) is not None

        answers = {led_to(event) for event in effects}
        if len(answers) > 1:
            return Verdict(None, "the event happens more than once")
        verdict = _denied(said, answers.pop(), "it is not among what led to it")
        return replace(verdict, event=effects[0]) if verdict.holds else verdict

    # Attributes, motion and counts.

    def _attribute(self, said: Statement) -> Verdict:
        o = self.scene.objects[self._one(said.objects[0])]
        own = [getattr(o, name) for name in NAMES]
        return _denied(said, all(word in own for word in said.words), f"it is {indefinite(o.name)}")

    def _presence(self, said: Statement) -> Verdict:
        found = len(self._fitting(said.objects[0]))
        if said.number is not None:
            return Verdict(found == said.number, f"there are {found}")
        return _denied(said, found > 0, "there is none")

    def _motion(self, said: Statement) -> Verdict:
        (state,) = said.words
        found = self._one(said.objects[0])
        if said.frame is None and state in ("moving", "stationary"):
            ever = found in self._in_state("ever moving", 0)
            if ever == (found in self._in_state("ever stationary", 0)):
                return Verdict(None, "it moves and rests, and no frame is given")
            return Verdict(ever == (state == "moving"), f"it is {'always' if ever else 'never'} moving")
        return Verdict(any(found in self._in_state(state, f) for f in self._frames(said)), f"it is not {state} then")

    def _count(self, said: Statement) -> Verdict:
        members = set(self._fitting(said.objects[0])) if said.objects else set()
        if said.words:
            counts = [len(self._in_state(said.words[0], f) & members) for f in self._frames(said)]
        else:
            found = self._matching(said.events[0], self.scene.events)
            found = [e for e in found if not said.objects or members.intersection(e.objects)]
            counts = [len(side) for side in self._sides(said, found)]
        return Verdict(said.number in counts, f"there are {counts[len(counts) // 2]}")

    def _frames(self, said: Statement) -> range:
        """The stated frame with its tolerance, within the video."""
        last = self.scene.n_frames - 1
        if said.frame is None:
            return range(1)
        if said.frame > last:
            raise _Undecided(False, f"the video ends at frame {last}")
        return range(max(said.frame - self.tolerance, 0), min(said.frame + self.tolerance, last) + 1)

    def _in_state(self, state: str, frame: int) -> set[int]:
        """Objects that are in a state of motion at a frame, or over the video."""
        if self.scene.moving is None:
            raise _Undecided(None, "motion is not known in this scene")
        visible, moving = self.scene.visible, self.scene.visible & self.scene.moving
        flags = {
            "moving": moving[:, frame],
            "stationary": visible[:, frame] & ~moving[:, frame],
            "ever moving": moving.any(1),
            "never moving": visible.any(1) & ~moving.any(1),
            "ever stationary": (visible & ~moving).any(1),
        }[state]
        return {int(i) for i in np.flatnonzero(flags)}


def _denied(said: Statement, holds: bool, reason: str) -> Verdict:
    return Verdict(not holds, "the contrary holds") if said.negated else Verdict(holds, reason)
