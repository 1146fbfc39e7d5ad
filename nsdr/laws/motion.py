"""Evidence against the laws of motion.

The evidence against a law is a log-likelihood ratio (nats): how much worse the tracks fit lawful motion than motion that breaks
the law once. Under the laws, an object slides freely between its contacts (`nsdr.laws.stretches`). So each change of motion
needs a contact, in which both objects change as masses and restitution allow, and objects that meet must change.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby, pairwise, product
from typing import NamedTuple

import numpy as np

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.bodies import corner_world
from nsdr.laws.breaks import (
    FIRST_NOISE_WORLD,
    JUMP_FRAMES,
    MIN_EVIDENCE,
    SEEN_GAP_FRAMES,
    SURE_FRAMES,
    Break,
    cut,
    merge,
    noise_of,
    positions_of,
)
from nsdr.laws.exchange import MIN_ALONG, collision_evidence
from nsdr.laws.stretches import CUT_GAIN, TrackStretch
from nsdr.validation import FloatArray
from nsdr.world.camera import on_ground

REACH_NOISE_WORLD = 0.01
"""Standard deviation of the distance at which two objects touch (world units in CLEVRER)."""
SAME_FRAMES = 3
"""Two objects whose motion changes within this many frames may do so in the same contact."""
BETWEEN_HITS_WORLD = 0.25
"""How far an object may move between two hits that look like one change: at the fastest start, in `SAME_FRAMES` (world units
in CLEVRER)."""
UNSEEN_FRAMES = 10
"""Objects may touch up to this long before they are first seen or after they are last seen (frames)."""
CROWDED_FRAMES = 10
"""Changes of motion within this many frames of a contact may be part of it, or show that a third object takes part. Chosen on
the training suites of docs/judge.md."""
MAX_HIDDEN_FRAMES = 24
"""If an object is hidden for longer at a change, the change does not show the effect of a single contact (frames)."""
CAUSE_FRAMES = 6
"""Evidence explains weaker evidence about the same object within this many frames."""
TOUCH_NATS = 4.0
"""Two objects touch if there is less evidence than this against their contact (nats)."""
BROKEN_NATS = 200.0
"""Upper limit of the evidence of each broken law when both directions of time are compared (nats)."""
MASS_RATIOS = 15
"""Number of ratios of the masses of two objects that are tried to explain a collision."""
MORE_RESTITUTION = 0.16
"""A collision may show a restitution that is larger by this than that of its objects; CLEVRER's is 0.64, and up to 0.76 was
measured in official proposals."""
MIN_CLOSING_WORLD_PER_S = 0.05
"""Lower limit of the approach speed by which the separation speed is divided for a restitution (world units/s
in CLEVRER)."""


class Evidence(NamedTuple):
    """Evidence for a violation: the fields of `nsdr.types.Violation`, with a log-likelihood ratio (nats) as its strength."""

    law: str
    objects: tuple[int, ...]
    frame: int
    end: int
    amount: float
    unit: str
    nats: float
    looks: tuple[str, ...] = ()


def cut_motion(states: MotionStates, noise: float | None = None, known_ground: bool = False) -> "PiecewiseMotion":
    """Cut the tracks where their motion changes.

    Args:
        states: motion states of the objects.
        noise: standard deviation of each coordinate of reliable positions (world units); None to measure it.
        known_ground: whether the ground is known to be the world's.
    """
    every = range(len(states.objects))
    if noise is None:
        scales = states.world.scales
        first_noise = FIRST_NOISE_WORLD * scales.size
        tracks = (positions_of(states, i, first_noise, known_ground=True) for i in every)
        noise = noise_of((s for one in tracks for s in cut(one)), scales)
    first = PiecewiseMotion(states, noise, [cut(positions_of(states, i, noise, known_ground)) for i in every])
    # Changes are compared with the first cuts of all objects, including those that have been merged since.
    return replace(first, stretches=[merge(one, first.is_explained) for one in first.stretches])


@dataclass(frozen=True, eq=False)
class PiecewiseMotion:
    """The motion of the objects of a video as stretches of free sliding, and the evidence in it against the laws.

    Attributes:
        states: motion states of the objects.
        noise: standard deviation of each coordinate of reliable positions (world units).
        stretches: stretches of each object, in order of time.
    """

    states: MotionStates
    noise: float
    stretches: list[list[TrackStretch]]

    @cached_property
    def breaks(self) -> list[list[Break]]:
        """The changes of motion of each object."""
        return [[Break(a, b) for a, b in pairwise(one)] for one in self.stretches]

    @cached_property
    def _sure_breaks(self) -> list[list[Break]]:
        """The changes between stretches with so many positions that they are those of the object; shorter ones are left out."""
        sure = ([s for s in one if len(s) >= SURE_FRAMES] for one in self.stretches)
        return [[Break(a, b) for a, b in pairwise(one)] for one in sure]

    def is_explained(self, b: Break) -> bool:
        """Whether something lawful explains a change of motion."""
        return self._lawful_nats(b, self._contacts(b)) < TOUCH_NATS

    def motion(self) -> Iterator[Evidence]:
        """Find the evidence against all laws of motion."""
        yield from self._friction()
        yield from self._changes()
        yield from self._solidity()

    def cost(self) -> float:
        """Cost of the positions, the cuts and the broken laws of motion (nats)."""
        fit = sum(s.cost for one in self.stretches for s in one)
        cuts = CUT_GAIN * sum(len(one) for one in self.breaks)
        broken = [min(e.nats, BROKEN_NATS) for e in strongest(self.motion())]
        # One broken law is no reason to play the video backwards, so the strongest evidence counts at most as much as a cut.
        return fit + cuts + sum(broken) - max(max(broken, default=0.0) - CUT_GAIN, 0.0)

    def _friction(self) -> Iterator[Evidence]:
        """Find evidence against friction: stretches on another ground, joined where they follow each other."""
        for is_rough, group in (g for one in self.stretches for g in groupby(one, lambda s: s.gain > 0)):
            if is_rough:
                rough = list(group)
                most = max(rough, key=lambda s: s.gain)
                first, end = rough[0].other_ground_frames[0], rough[-1].other_ground_frames[1]
                nats = sum(s.gain for s in rough)
                yield Evidence("friction", (most.track.i,), first, end, most.ground.extra, "world units/s²", nats)

    def _changes(self) -> Iterator[Evidence]:
        """Find evidence against continuity, inertia, reaction and distance: changes of motion without a lawful cause."""
        for b in (b for one in self._sure_breaks for b in one):
            jump, kick, contacts = b.jump(), b.kick(), self._contacts(b)
            frame, is_direct = round(b.frame), b.before.b == b.after.a
            if jump.nats > kick.nats:
                if not is_direct:
                    continue
                # An object that is not seen for long, or that touches two others, may have moved on between two hits.
                touched = [*sorted(c.gap_nats for c in contacts), np.inf, np.inf]
                if b.missing_frames > JUMP_FRAMES:
                    nats = min(jump.nats, touched[0])
                elif jump.size < BETWEEN_HITS_WORLD * self.states.world.scales.frame:
                    nats = min(jump.nats, touched[1])
                else:
                    nats = jump.nats
                if nats > MIN_EVIDENCE:
                    yield Evidence("continuity", (b.i,), frame, frame + 1, jump.size, "world units", nats)
                continue
            nats = min(kick.nats, self._lawful_nats(b, contacts))
            if nats < MIN_EVIDENCE:
                continue
            touching = [c for c in contacts if c.gap_nats < TOUCH_NATS and c.exchange_nats is not None]
            apart = [c for c in contacts if (c.exchange_nats or 0.0) < c.gap_nats and self._repels(b, c)]
            if touching:
                best = min(touching, key=lambda c: c.nats)
                law, amount, unit = "reaction", best.restitution, "restitution"
            elif apart:
                best = min(apart, key=lambda c: c.nats)
                law, amount, unit = "distance", best.gap, "world units"
            else:
                yield Evidence("inertia", (b.i,), frame, frame + 1, kick.size, "world units/s", nats)
                continue
            pair = (min(b.i, best.j), max(b.i, best.j))
            yield Evidence(law, pair, frame, frame + 1, amount, unit, nats)

    def at(self, j: int, frame: float) -> TrackStretch | None:
        """The stretch of object j nearest to a frame; None if none is within `SAME_FRAMES`."""
        near = [s for s in self.stretches[j] if s.start - SAME_FRAMES <= frame <= s.last + SAME_FRAMES]
        return min(near, key=lambda s: max(s.start - frame, frame - s.last), default=None)

    def _sides(self, b: Break, j: int) -> list[tuple[TrackStretch, TrackStretch]]:
        """Pairs of stretches, each with enough positions, that may be the motion of object j before and after a change.

        Its changes soon before or after this one may be part of it, so the stretches need not be the nearest. If object j does
        not change at the same time, they may be the parts of one stretch.
        """
        change = min(self._changes_with(b, j), key=lambda o: abs(o.frame - b.frame), default=None)
        frame, last, start = b.frame, b.frame, b.frame
        if change is not None:
            frame, last, start = change.frame, change.before.last, change.after.start
        before, after = [], []
        for s in self.stretches[j]:
            if s.last < last - CROWDED_FRAMES or start + CROWDED_FRAMES < s.start:
                continue
            parts = s.parts(frame) if change is None else None
            if parts is not None:
                before.append(parts[0])
                after.append(parts[1])
            elif s.start + s.last < 2 * frame:
                before.append(s)
            else:
                after.append(s)
        return [(x, y) for x, y in product(before, after) if min(len(x), len(y)) >= SURE_FRAMES]

    def _lawful_nats(self, b: Break, contacts: "list[_Contact]") -> float:
        """Evidence against the best lawful cause of a change of velocity (nats)."""
        return min([self._unseen_nats(b), *(c.nats for c in contacts)])

    def _contacts(self, b: Break) -> "list[_Contact]":
        """Possible contacts with all other objects that are seen around a change of motion."""
        found = [self._contact(b, j) for j in range(len(self.stretches)) if j != b.i]
        return [c for c in found if c is not None]

    def _contact(self, b: Break, j: int) -> "_Contact | None":
        """How well a contact with object j explains a change of motion; None if object j is not seen around it."""
        gap, nats = self._gap(b, j)
        if np.isinf(nats):
            return None
        exchange, restitution = None, np.nan
        sides = list(product(self._sides(b, b.i), self._sides(b, j)))
        if sides and not self._may_have_another_cause(b, j):
            exchange, restitution = min(self._exchange(b, j, *pair) for pair in sides)
        return _Contact(j, gap, nats, exchange, restitution)

    def _may_have_another_cause(self, b: Break, j: int) -> bool:
        """Whether a third object may also hit object b.i or j around their contact, so that its effect is not seen alone."""
        pair, others = (b.i, j), [k for k in range(len(self.stretches)) if k not in (b.i, j)]
        for o in (o for k in others for o in self._changes_near(b, k)):
            if o.is_change and any(self._gap(o, i)[1] < TOUCH_NATS for i in pair):
                return True
        for o in (b, *(o for i in pair for o in self._changes_near(b, i))):
            is_same = abs(o.frame - b.frame) <= SAME_FRAMES
            if is_same and o.hidden_frames > MAX_HIDDEN_FRAMES:
                return True
            if is_same and o.hidden_frames <= SEEN_GAP_FRAMES:
                continue
            if not is_same and not self._unseen_nats(o):
                return True
            if any(self._gap(o, k)[1] < TOUCH_NATS and not self._is_unchanged(k, o) for k in others):
                return True
        return False

    def _changes_near(self, b: Break, k: int) -> list[Break]:
        """Possible changes of object k within `CROWDED_FRAMES` of another change."""
        return [o for o in self.breaks[k] if abs(o.frame - b.frame) <= CROWDED_FRAMES and o.may_be_change]

    def _is_unchanged(self, k: int, b: Break) -> bool:
        """Whether object k is seen to move on as before around a change of another object."""
        return bool(self._sides(b, k)) and not self._changes_near(b, k)

    def _changes_with(self, b: Break, j: int) -> list[Break]:
        """Changes of object j at the time of another change."""
        return [o for o in self.breaks[j] if abs(o.frame - b.frame) <= SAME_FRAMES]

    def _repels(self, b: Break, contact: "_Contact") -> bool:
        """Whether the other object changes in the opposite direction at the same time without contact with a third object."""
        opposite = (o for o in self._changes_with(b, contact.j) if _is_opposite(b, o))
        return any(all(c.nats >= TOUCH_NATS for c in self._contacts(o) if c.j != b.i) for o in opposite)

    def _gap(self, b: Break, j: int) -> tuple[float, float]:
        """The gap between the changing object and object j (world units), and the evidence for it (nats).

        Both are infinite if object j is not seen.
        """
        when, gap, nats = b.window, np.inf, np.inf
        near = self._near(j, when)
        for one in (b.before, b.after):
            for other in near:
                reach = _touching(one, other) + sum(corner_world(s.shape) for s in (one, other))
                gaps = np.maximum(_distance(one, other, when) - reach, 0.0)
                found = gaps**2 / (2 * self._distance_variance(one, other, when))
                if found.min() < nats:
                    gap, nats = float(gaps[found.argmin()]), float(found.min())
        return gap, nats

    def _near(self, j: int, when: FloatArray) -> list[TrackStretch]:
        """Stretches of object j that may give its position in frames (F,): those in them, and the nearest before and after."""
        every = self.stretches[j]
        first = [every[0].start - UNSEEN_FRAMES, *(s.last - SAME_FRAMES for s in every[:-1])]
        last = [*(s.start + SAME_FRAMES for s in every[1:]), every[-1].last + UNSEEN_FRAMES]
        return [s for s, a, b in zip(every, first, last, strict=True) if a <= when[-1] and when[0] <= b]

    def _unseen_nats(self, b: Break) -> float:
        """Evidence against a hit by an object centred outside the image (nats): 0 if it can be there, otherwise infinite."""
        shape = b.before.shape
        reach = shape.radius_world + max(one.radius_world for one in self.states.world.vocabulary.shapes)
        other = b.position - reach * b.change / max(float(np.hypot(*b.change)), 1e-9)
        centre = self.states.camera.pixels(on_ground(other[None], shape.height_world))[0]
        size = self.states.camera.width, self.states.camera.height
        return np.inf if (centre > 0).all() and (centre < size).all() else 0.0

    def _solidity(self) -> Iterator[Evidence]:
        """Find evidence against solidity: pairs of objects that are nearer to each other than is possible."""
        for i, mine in enumerate(self.stretches):
            for j in range(i):
                overlaps = (self._overlap(one, other) for one in mine for other in self.stretches[j])
                found = [e for e in overlaps if e is not None]
                best = max(found, key=lambda e: e.nats, default=None)
                if best is not None and best.nats > MIN_EVIDENCE:
                    # Tracks are cut while one object hides the other, so all overlaps are one violation.
                    yield best._replace(frame=min(e.frame for e in found), end=max(e.end for e in found))

    def _overlap(self, one: TrackStretch, other: TrackStretch) -> Evidence | None:
        """Evidence against solidity from two stretches; None if the objects do not overlap."""
        # A stretch may have been cut a frame too late, so frames near its ends are left out.
        frames = np.arange(max(one.start, other.start) + 2.0, min(one.last, other.last) - 1.0)
        if not len(frames):
            return None
        distance = _distance(one, other, frames)
        depth = np.maximum(_touching(one, other) - distance, 0.0)
        nats = depth**2 / (2 * self._distance_variance(one, other, frames))
        inside, deepest = frames[depth > 0], int(nats.argmax())
        if not len(inside):
            return None
        pair = (other.track.i, one.track.i)
        found = int(inside[0]), int(inside[-1]) + 1, float(distance[deepest])
        return Evidence("solidity", pair, *found, "world units", float(nats[deepest]))

    def _distance_variance(self, one: TrackStretch, other: TrackStretch, frames: FloatArray) -> FloatArray:
        """(F,) variance of the distance between two objects minus the distance at which they touch (world units²)."""
        mine, others = (s.position_variance(frames, s.track.noise) for s in (one, other))
        return mine + others + (REACH_NOISE_WORLD * self.states.world.scales.size) ** 2

    @cached_property
    def _mass_ratios(self) -> FloatArray:
        """Ratios of the masses of two objects that are tried to explain a collision."""
        low, high = self.states.world.physics.mass_range
        return np.geomspace(low / high, high / low, MASS_RATIOS)

    def _exchange(
        self, b: Break, j: int, mine: Sequence[TrackStretch], other: Sequence[TrackStretch]
    ) -> tuple[float, float]:
        """`collision_evidence` of a changing object with object j, from the motion of both before and after the change."""
        world, objects = self.states.world, self.states.objects
        restitution = world.vocabulary.pair_restitution(objects[b.i].material, objects[j].material)
        most, least_speed = restitution + MORE_RESTITUTION, MIN_CLOSING_WORLD_PER_S * world.scales.speed
        return collision_evidence(mine, other, b.frame, self._mass_ratios, most, least_speed)


def strongest(found: Iterable[Evidence]) -> list[Evidence]:
    """Remove evidence that stronger evidence about the same object near it explains. The strongest evidence is first."""
    kept: list[Evidence] = []
    for e in sorted(found, key=lambda e: -e.nats):
        explained = any(
            set(e.objects) & set(k.objects) and k.frame - CAUSE_FRAMES <= e.frame <= k.end + CAUSE_FRAMES for k in kept
        )
        if not explained:
            kept.append(e)
    return kept


class _Contact(NamedTuple):
    """How well a contact explains a change of motion.

    Attributes:
        j: id of the other object.
        gap: gap between the two objects (world units).
        gap_nats: evidence against the contact from the gap (nats).
        exchange_nats: evidence against it from the changes of both velocities (nats); None if these are not known.
        restitution: ratio of separation speed to approach speed.
    """

    j: int
    gap: float
    gap_nats: float
    exchange_nats: float | None
    restitution: float

    @property
    def nats(self) -> float:
        """Evidence against the contact as the cause of the change (nats)."""
        return self.gap_nats + (self.exchange_nats or 0.0)


def _is_opposite(one: Break, other: Break) -> bool:
    """Whether there is evidence that the velocity of another object changes in the opposite direction."""
    kick = other.kick()
    return kick.nats > MIN_EVIDENCE and float(one.change @ other.change) < -MIN_ALONG * one.kick().size * kick.size


def _distance(one: TrackStretch, other: TrackStretch, frames: FloatArray) -> FloatArray:
    """(F,) distance between the centres of two objects (world units)."""
    return np.asarray(np.linalg.norm(one.position_at(frames) - other.position_at(frames), axis=1))


def _touching(one: TrackStretch, other: TrackStretch) -> float:
    """The least distance of the centres of two objects that do not overlap (world units)."""
    return sum(min(s.shape.size_world[:2]) / 2 for s in (one, other))
