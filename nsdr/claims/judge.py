"""Whether statements hold in a scene."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nsdr.claims.statements import PAST_KINDS, EventPhrase, ObjectPhrase, Statement
from nsdr.symbolic.causal import ancestor_sets
from nsdr.types import Event, Scene
from nsdr.world.vocabulary import ATTRIBUTES

__all__ = ["ClaimJudge", "Verdict"]


@dataclass(frozen=True)
class Verdict:
    """Whether a statement holds.

    Attributes:
        holds: True or False; None if it can't be said.
        reason: why not, or why it can't be said; "" if it holds.
        objects: ids of the objects that it names, as far as they are known.
        event: the event of the scene that it is about, if it holds and is about one.
        vacuous: whether it counts none of a class of which the scene has no object.
    """

    holds: bool | None
    reason: str = ""
    objects: tuple[int, ...] = ()
    event: Event | None = None
    vacuous: bool = False


class _Undecided(Exception):
    """A noun phrase that stands for no object (False) or for one that can't be told (None)."""

    def __init__(self, holds: bool | None, reason: str) -> None:
        super().__init__(reason)
        self.holds, self.reason = holds, reason


class ClaimJudge:
    """Compares statements with one scene, which counts as the truth.

    Args:
        scene: the scene.
        tolerance_frames: by how many frames a stated frame may differ from the scene's.
    """

    def __init__(self, scene: Scene, tolerance_frames: int) -> None:
        self.scene, self.tolerance = scene, tolerance_frames
        bits = ancestor_sets(scene.events)
        self._ancestors = [
            [scene.events[j] for j in range(i) if bits[1 << i] >> j & 1] for i in range(len(scene.events))
        ]
        self._methods = {
            **dict.fromkeys(PAST_KINDS.values(), self._observed),
            "future": self._future,
            "counterfactual": self._counterfactual,
            "order": self._order,
            "cause": self._cause,
            "attribute": self._attribute,
            "presence": self._presence,
            "motion": self._motion,
            "count": self._count,
        }

    def judge(self, statement: Statement) -> Verdict:
        """Whether a statement, which says no `LAST_FRAME`, holds."""
        try:
            objects = self._named(statement)
            verdict = self._methods[statement.kind](statement)
        except _Undecided as e:
            known = [i for p in _phrases(statement) for i in self._fitting(p) if len(self._fitting(p)) == 1]
            # What is denied of an object that does not exist is neither right nor wrong.
            holds = None if statement.negated else e.holds
            return Verdict(holds, e.reason, tuple(dict.fromkeys(known)))
        return replace(verdict, reason="" if verdict.holds else verdict.reason, objects=objects)

    # Objects.

    def _fitting(self, phrase: ObjectPhrase) -> list[int]:
        if not phrase.known:
            return []
        found = []
        for o in self.scene.objects:
            own = (o.color, o.material, o.shape)
            if all(word in own for word in phrase.words):
                found.append(o.id)
        return found

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
        found = self._meant(phrase)
        if len(found) > 1:
            raise _Undecided(None, f"'{phrase.text}' fits {len(found)} objects")
        return found[0]

    def _named(self, statement: Statement) -> tuple[int, ...]:
        classes = statement.objects[:1] if statement.number is not None or statement.kind == "presence" else ()
        named: list[int] = []
        for phrase in _phrases(statement):
            if phrase not in classes:
                found = self._meant(phrase)
                if statement.negated and not phrase.definite:
                    raise _Undecided(None, f"'{phrase.text}' in a denied sentence may mean any or a particular object")
                named += found if len(found) == 1 else []
        return tuple(dict.fromkeys(named))

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

    def _near(self, events: Sequence[Event], frame: int | None) -> list[Event]:
        return [e for e in events if frame is None or abs(e.frame - frame) <= self.tolerance]

    def _happens(self, statement: Statement, events: Iterable[Event]) -> Verdict:
        (phrase,) = statement.events
        matching = self._matching(phrase, events)
        frames = " and ".join(str(e.frame) for e in matching)
        if statement.relation:
            assert statement.frame is not None
            boundaries = range(statement.frame - self.tolerance, statement.frame + self.tolerance + 1)
            sides = [[e for e in matching if _on_side(e.frame, f, statement.relation)] for f in boundaries]
            reason = f"it happens at frame {frames}" if matching else "it does not happen"
            if statement.negated:
                return Verdict([] in sides, reason)
            found = max(sides, key=len)
            return Verdict(bool(found), reason, event=found[0] if found else None)
        near = self._near(matching, phrase.frame)
        if not statement.negated:
            reason = f"it happens at frame {frames}, not at frame {phrase.frame}" if matching else "it does not happen"
            return Verdict(bool(near), reason, event=near[0] if near else None)
        if near and phrase.frame is not None and phrase.frame not in [e.frame for e in near]:
            return Verdict(None, f"it happens at frame {frames}, which is within the tolerance")
        return Verdict(not near, f"it happens at frame {frames}")

    def _observed(self, statement: Statement) -> Verdict:
        return self._happens(statement, self.scene.events)

    def _future(self, statement: Statement) -> Verdict:
        if self.scene.unseen is None:
            return Verdict(None, "events after the video are not known in this scene")
        if statement.events[0].kind != "collision":
            return Verdict(None, "only collisions are known after the video")
        if statement.number is None:
            return self._happens(statement, self.scene.unseen)
        found = len(self._matching(statement.events[0], self.scene.unseen))
        return Verdict(found == statement.number, f"there are {found}")

    def _counterfactual(self, statement: Statement) -> Verdict:
        assert statement.removed is not None
        removed = self._one(statement.removed)
        known = self.scene.counterfactual or {}
        if removed not in known:
            return Verdict(None, f"events without {statement.removed.text} are not known in this scene")
        if statement.events[0].kind != "collision":
            return Verdict(None, "only collisions are known without an object")
        return self._happens(statement, known[removed])

    # Order and causes.

    def _order(self, statement: Statement) -> Verdict:
        if statement.number is not None:
            return self._place(statement)
        first, second = (self._near(self._matching(p, self.scene.events), p.frame) for p in statement.events)
        if not first or not second:
            return Verdict(False, "one of the events does not happen")
        sign = 1 if statement.relation == "after" else -1
        answers = {(a.frame - b.frame) * sign > 0 for a in first for b in second}
        if len(answers) > 1:
            return Verdict(None, "an event happens more than once")
        return Verdict(answers.pop(), f"the first is at frame {first[0].frame}, the second at frame {second[0].frame}")

    def _place(self, statement: Statement) -> Verdict:
        (phrase,) = statement.events
        assert statement.number is not None
        index = statement.number - 1 if statement.number > 0 else -1
        if not statement.objects:  # the first collision is of two objects
            row = [e for e in self.scene.events if e.kind == "collision"]
            if not row or index >= len(row):
                return Verdict(False, f"there are {len(row)} collisions")
            return Verdict(self._fits(phrase, row[index].objects), f"that one is at frame {row[index].frame}")
        members, filler = set(self._fitting(statement.objects[0])), self._one(statement.objects[1])
        partner = self._one(phrase.objects[0]) if phrase.objects else None
        row_of = []
        for event in self.scene.events:
            others = [i for i in event.objects if i != partner]
            if event.kind == phrase.kind and (partner is None or partner in event.objects) and others[0] in members:
                row_of.append((event.frame, others[0]))
        if index >= len(row_of):
            return Verdict(False, f"there are {len(row_of)}")
        if index < 0 and not row_of:
            return Verdict(False, "there is none")
        frame, found = row_of[index]
        return Verdict(found == filler, f"it is the {self.scene.objects[found].name}, at frame {frame}")

    def _cause(self, statement: Statement) -> Verdict:
        *before, effect = statement.events
        effects = self._near(self._matching(effect, self.scene.events), effect.frame)
        causes = [self._near(self._matching(p, self.scene.events), p.frame) for p in before]
        if not effects or not all(causes):
            return Verdict(None if statement.negated else False, "one of the events does not happen")
        responsible = set(self._meant(statement.objects[0])) if statement.objects else set()
        answers = set()
        for event in effects:
            ancestors = self._ancestors[self.scene.events.index(event)]
            if before:
                answers.add(any(cause in ancestors for cause in causes[0]))
            else:
                answers.add(any(responsible & set(e.objects) for e in (event, *ancestors)))
        if len(answers) > 1:
            return Verdict(None, "the event happens more than once")
        return _denied(statement, answers.pop(), "it is not among what led to it")

    # Attributes, motion and counts.

    def _attribute(self, statement: Statement) -> Verdict:
        o = self.scene.objects[self._one(statement.objects[0])]
        own = [getattr(o, name) for name in ATTRIBUTES]
        return _denied(statement, all(word in own for word in statement.words), f"it is a {o.name}")

    def _presence(self, statement: Statement) -> Verdict:
        found = len(self._fitting(statement.objects[0]))
        if statement.number is not None:
            return Verdict(found == statement.number, f"there are {found}")
        return _denied(statement, found > 0, "there is none")

    def _motion(self, statement: Statement) -> Verdict:
        (state,) = statement.words
        found = self._one(statement.objects[0])
        if statement.frame is None and state in ("moving", "stationary"):
            ever, rests = found in self._moving("ever moving", 0), self._rests(found)
            if ever == rests:
                return Verdict(None, "it moves and rests, and no frame is given")
            return Verdict(ever == (state == "moving"), f"it is {'always' if ever else 'never'} moving")
        return Verdict(any(found in self._moving(state, f) for f in self._frames(statement)), f"it is not {state} then")

    def _count(self, statement: Statement) -> Verdict:
        assert statement.number is not None
        members = set(self._fitting(statement.objects[0])) if statement.objects else set()
        if statement.words:
            counts = [len(self._moving(statement.words[0], f) & members) for f in self._frames(statement)]
        else:
            (phrase,) = statement.events
            found = self._matching(phrase, self.scene.events)
            found = [e for e in found if not statement.objects or members & set(e.objects)]
            if not statement.relation:
                counts = [len(found)]
            else:
                assert statement.frame is not None
                boundaries = range(statement.frame - self.tolerance, statement.frame + self.tolerance + 1)
                counts = [sum(_on_side(e.frame, f, statement.relation) for e in found) for f in boundaries]
        vacuous = bool(statement.objects) and not members and statement.number == 0
        return Verdict(statement.number in counts, f"there are {counts[len(counts) // 2]}", vacuous=vacuous)

    def _frames(self, statement: Statement) -> range:
        """The stated frame with its tolerance, within the video."""
        last = self.scene.n_frames - 1
        if statement.frame is None:
            return range(1)
        frame = statement.frame
        if frame > last:
            raise _Undecided(False, f"the video ends at frame {last}")
        return range(max(frame - self.tolerance, 0), min(frame + self.tolerance, last) + 1)

    def _moving(self, state: str, frame: int) -> set[int]:
        """Objects that are in a state of motion at a frame, or over the video."""
        if self.scene.moving is None:
            raise _Undecided(None, "motion is not known in this scene")
        visible, moving = self.scene.visible, self.scene.visible & self.scene.moving
        flags = {
            "moving": moving[:, frame],
            "stationary": visible[:, frame] & ~moving[:, frame],
            "ever moving": moving.any(1),
            "never moving": visible.any(1) & ~moving.any(1),
        }[state]
        return {int(i) for i in np.flatnonzero(flags)}

    def _rests(self, found: int) -> bool:
        assert self.scene.moving is not None
        return bool((self.scene.visible[found] & ~self.scene.moving[found]).any())


def _on_side(frame: int, boundary: int, relation: str) -> bool:
    return frame > boundary if relation == "after" else frame < boundary


def _denied(statement: Statement, holds: bool | None, reason: str) -> Verdict:
    if statement.negated and holds is not None:
        return Verdict(not holds, "the contrary holds")
    return Verdict(holds, reason)


def _phrases(statement: Statement) -> list[ObjectPhrase]:
    removed = [statement.removed] if statement.removed else []
    return [*statement.objects, *(p for e in statement.events for p in e.objects), *removed]
