"""What speaks against the laws of motion: how much worse the tracks fit lawful motion than motion that breaks it once, in nats.

A lawful object slides freely between its contacts (`nsdr.laws.stretches`). So each change of motion needs a contact, in which
both objects change as masses and restitution allow, and objects that meet need to change.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np

from nsdr.dynamics.motion_states import MotionStates
from nsdr.dynamics.physics.contact_geometry import CORNER_WORLD
from nsdr.laws.breaks import (
    FIRST_NOISE_WORLD,
    JUMP_FRAMES,
    MIN_EVIDENCE,
    SURE_FRAMES,
    VELOCITY_NOISE,
    Break,
    cut,
    merge,
    noise_of,
    positions_of,
)
from nsdr.laws.stretches import CUT_GAIN, TrackStretch
from nsdr.validation import FloatArray
from nsdr.world.camera import on_ground
from nsdr.world.physics_constants import MASS_RANGE, OBJECT_RADIUS_WORLD

REACH_NOISE_WORLD = 0.01
"""Standard deviation of the distance at which two objects touch (world units)."""
SAME_FRAMES = 3
"""Two objects that change within so many frames may do so in one contact."""
UNSEEN_FRAMES = 10
"""Objects may touch so long before they are first seen, or after they are last seen (frames)."""
CROWDED_FRAMES, CROWDED_WORLD = 10, 0.7
"""Other changes so long before or after a contact make its effect unknown, those of a third object if it comes so near (frames,
world units): chosen on the training suites of docs/judge.md."""
HIDDEN_FRAMES = 24
"""Changes during which an object is hidden for longer do not show the effect of one contact alone (frames)."""
CAUSE_FRAMES = 6
"""Weaker evidence about an object so near to other evidence is explained by it (frames)."""
TOUCH_NATS = 4.0
"""Objects against whose contact less speaks touch (nats)."""
BROKEN_NATS = 200.0
"""Most that each further broken law counts for when both directions of time are compared (nats)."""
MASS_RATIOS = np.geomspace(MASS_RANGE[0] / MASS_RANGE[1], MASS_RANGE[1] / MASS_RANGE[0], 15)
MAX_RESTITUTION = 0.8
"""Largest restitution that a collision may show; CLEVRER's is 0.64, and up to 0.76 was measured in official proposals."""
MIN_CLOSING_WORLD_PER_S = 0.05
"""Speeds of approach that restitutions are divided by are at least this (world units/s)."""
MIN_ALONG = 0.6
"""Least cosine between an impulse and the line from one object to the other: cubes push along their sides."""


class Evidence(NamedTuple):
    """What speaks for one violation: like `nsdr.types.Violation`, with nats in place of a probability."""

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
        states: the tracks.
        noise: standard deviation of their positions; None to measure it.
        known_ground: whether the ground is known to be CLEVRER's.
    """
    every = range(len(states.objects))
    if noise is None:
        noise = noise_of(s for i in every for s in cut(positions_of(states, i, FIRST_NOISE_WORLD, known_ground=True)))
    first = PiecewiseMotion(states, noise, [cut(positions_of(states, i, noise, known_ground)) for i in every])
    # Each object's cuts are judged beside all that there were at first, also those of others that are merged by now.
    return replace(first, stretches=[merge(one, first.is_explained) for one in first.stretches])


@dataclass(frozen=True, eq=False)
class PiecewiseMotion:
    """The motion of a video's objects in stretches of free sliding, and what in it is against the laws.

    Attributes:
        states: the tracks.
        noise: standard deviation of their positions (world units).
        stretches: of each object, in order of time.
    """

    states: MotionStates
    noise: float
    stretches: list[list[TrackStretch]]

    @cached_property
    def breaks(self) -> list[list[Break]]:
        """The changes of motion of each object."""
        return [[Break(a, b) for a, b in pairwise(one)] for one in self.stretches]

    def is_explained(self, b: Break) -> bool:
        """Whether something lawful explains a change of motion."""
        return self._lawful_nats(b, self._contacts(b)) < TOUCH_NATS

    def motion(self) -> Iterator[Evidence]:
        """Against the laws of motion."""
        yield from self._friction()
        yield from self._changes()
        yield from self._solidity()

    def cost(self) -> float:
        """Of the positions, the cuts, and all that is against the laws of motion (nats)."""
        fit = sum(s.cost for one in self.stretches for s in one)
        cuts = CUT_GAIN * sum(len(one) for one in self.breaks)
        broken = [min(e.nats, BROKEN_NATS) for e in strongest(self.motion())]
        # One broken law is no reason to turn the video around: the worst counts as a cut at most.
        return fit + cuts + sum(broken) - max(max(broken, default=0.0) - CUT_GAIN, 0.0)

    def _friction(self) -> Iterator[Evidence]:
        """Against friction: stretches on another ground, in a row on the same one."""
        for is_rough, group in (g for one in self.stretches for g in groupby(one, lambda s: s.gain > 0)):
            if is_rough:
                rough = list(group)
                most = max(rough, key=lambda s: s.gain)
                first, end = rough[0].rough_frames[0], rough[-1].rough_frames[1]
                nats = sum(s.gain for s in rough)
                yield Evidence("friction", (most.track.i,), first, end, most.ground.extra, "world units/s²", nats)

    def _changes(self) -> Iterator[Evidence]:
        """Against continuity, inertia, reaction and action at a distance alone: changes of motion without a good reason."""
        for b in (b for one in self.breaks for b in one):
            if not b.is_sure:
                continue
            jump, kick, contacts = b.jump(), b.kick(), self._contacts(b)
            frame = round(b.frame)
            if jump.nats > kick.nats:
                # What is not seen at all for long may have been hit twice.
                touched = min((c.gap_nats for c in contacts), default=np.inf)
                nats = jump.nats if b.missing_frames <= JUMP_FRAMES else min(jump.nats, touched)
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
        """The stretch of object j that a frame is in, or nearest to; None where none is within `SAME_FRAMES`."""
        near = [s for s in self.stretches[j] if s.start - SAME_FRAMES <= frame <= s.last + SAME_FRAMES]
        return min(near, key=lambda s: max(s.start - frame, frame - s.last), default=None)

    def _sides(self, b: Break, j: int) -> tuple[TrackStretch, TrackStretch] | None:
        """Object j's motion before and after a change of another: of two stretches, or of the parts of one; None where too
        little is seen."""
        for other in self._changes_with(b, j):
            return other.before, other.after
        s = self.at(j, b.frame)
        return None if s is None else s.parts(b.frame)

    def _lawful_nats(self, b: Break, contacts: "list[_Contact]") -> float:
        """Against the best lawful reason of a change of velocity."""
        return min([self._unseen_nats(b), *(c.nats for c in contacts)])

    def _contacts(self, b: Break) -> "list[_Contact]":
        """Contacts with each other object that is seen around a change of motion."""
        found = [self._contact(b, j) for j in range(len(self.stretches)) if j != b.i]
        return [c for c in found if c is not None]

    def _contact(self, b: Break, j: int) -> "_Contact | None":
        """How well a contact with object j explains a change of motion; None where j is not seen around it."""
        frame, (gap, nats) = b.frame, self._gap(b, j)
        if np.isinf(nats):
            return None
        sides = self._sides(b, j)
        exchange, restitution = None, np.nan
        if sides is not None and not self._is_crowded(b, j):
            # What is hidden for long may have changed twice.
            hidden = [o.hidden_frames for o in (b, *self._changes_with(b, j))]
            if max(hidden) <= HIDDEN_FRAMES and all(len(s) >= SURE_FRAMES for s in (b.before, b.after, *sides)):
                exchange, restitution = _exchange((b.before, b.after), sides, frame)
        return _Contact(j, gap, nats, exchange, restitution)

    def _changes_with(self, b: Break, j: int) -> list[Break]:
        """Changes of object j at the same time."""
        return [o for o in self.breaks[j] if abs(o.frame - b.frame) <= SAME_FRAMES]

    def _repels(self, b: Break, contact: "_Contact") -> bool:
        """Whether the other object changes at the same time in the opposite direction, which no third object explains."""
        opposite = (o for o in self._changes_with(b, contact.j) if _is_opposite(b, o))
        return any(all(c.nats >= TOUCH_NATS for c in self._contacts(o) if c.j != b.i) for o in opposite)

    def _gap(self, b: Break, j: int) -> tuple[float, float]:
        """Between the object that changes and object j (world units), and the evidence of it (nats); infinite where j is not
        seen."""
        when, gap, nats = b.window, np.inf, np.inf
        near = self._near(j, when)
        for one in (b.before, b.after):
            for other in near:
                reach = 2 * OBJECT_RADIUS_WORLD + CORNER_WORLD * (one.shape, other.shape).count("cube")
                gaps = np.maximum(_distance(one, other, when) - reach, 0.0)
                found = gaps**2 / (2 * _distance_variance(one, other, when))
                if found.min() < nats:
                    gap, nats = float(gaps[found.argmin()]), float(found.min())
        return gap, nats

    def _near(self, j: int, when: FloatArray) -> list[TrackStretch]:
        """Stretches that may tell where object j is at frames (F,): from the one before to the one after it."""
        every = self.stretches[j]
        first = [every[0].start - UNSEEN_FRAMES, *(s.last - SAME_FRAMES for s in every[:-1])]
        last = [*(s.start + SAME_FRAMES for s in every[1:]), every[-1].last + UNSEEN_FRAMES]
        return [s for s, a, b in zip(every, first, last, strict=True) if a <= when[-1] and when[0] <= b]

    def _is_crowded(self, b: Break, j: int) -> bool:
        """Whether more happens around a contact than that of the two objects, so that its effect alone is not seen."""
        frame, pair = b.frame, [b.i, j]
        around = slice(max(round(frame) - CROWDED_FRAMES, 0), round(frame) + CROWDED_FRAMES + 1)
        places = np.where(self.states.present[..., None], self.states.location_world, np.nan)[:, around]
        for k, breaks in enumerate(self.breaks):
            for other in breaks:
                since = abs(other.frame - frame)
                if since > CROWDED_FRAMES or other.is_doubtful:
                    continue
                if k in pair:
                    if since > SAME_FRAMES:
                        return True
                elif (np.linalg.norm(places[pair] - places[k], axis=-1) < CROWDED_WORLD).any():
                    return True
        return False

    def _unseen_nats(self, b: Break) -> float:
        """Of the explanation that an object hit it whose centre is not in the image."""
        other = b.place - 2 * OBJECT_RADIUS_WORLD * b.change / max(float(np.hypot(*b.change)), 1e-9)
        centre = self.states.camera.pixels(on_ground(other[None]))[0]
        size = self.states.camera.width, self.states.camera.height
        return np.inf if (centre > 0).all() and (centre < size).all() else 0.0

    def _solidity(self) -> Iterator[Evidence]:
        """Against solidity: objects that are nearer to each other than they can be."""
        for i, mine in enumerate(self.stretches):
            for j in range(i):
                overlaps = (self._overlap(one, other) for one in mine for other in self.stretches[j])
                found = [e for e in overlaps if e is not None]
                best = max(found, key=lambda e: e.nats, default=None)
                if best is not None and best.nats > MIN_EVIDENCE:
                    # While one hides the other, tracks are cut.
                    yield best._replace(frame=min(e.frame for e in found), end=max(e.end for e in found))

    def _overlap(self, one: TrackStretch, other: TrackStretch) -> Evidence | None:
        """Against solidity in two stretches; None where they do not overlap."""
        # Near its ends a stretch may have been cut a frame too late.
        frames = np.arange(max(one.start, other.start) + 2.0, min(one.last, other.last) - 1.0)
        if not len(frames):
            return None
        distance = _distance(one, other, frames)
        depth = np.maximum(2 * OBJECT_RADIUS_WORLD - distance, 0.0)
        nats = depth**2 / (2 * _distance_variance(one, other, frames))
        inside, deepest = frames[depth > 0], int(nats.argmax())
        if not len(inside):
            return None
        pair = (other.track.i, one.track.i)
        found = int(inside[0]), int(inside[-1]) + 1, float(distance[deepest])
        return Evidence("solidity", pair, *found, "world units", float(nats[deepest]))


def strongest(found: Iterable[Evidence]) -> list[Evidence]:
    """The evidence without what stronger one near it explains, such as a collision's about either of its objects."""
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
        j: the other object.
        gap: between the two (world units).
        gap_nats: of the gap.
        exchange_nats: of how both change; None where that is not seen.
        restitution: speed of separation over speed of approach.
    """

    j: int
    gap: float
    gap_nats: float
    exchange_nats: float | None
    restitution: float

    @property
    def nats(self) -> float:
        """Against the contact as the reason."""
        return self.gap_nats + (self.exchange_nats or 0.0)


def _is_opposite(one: Break, other: Break) -> bool:
    """Whether another object's velocity surely changes, and in the opposite direction."""
    kick = other.kick()
    return kick.nats > MIN_EVIDENCE and float(one.change @ other.change) < -MIN_ALONG * one.kick().size * kick.size


def _distance(one: TrackStretch, other: TrackStretch, frames: FloatArray) -> FloatArray:
    """(F,) between the centres of two objects (world units)."""
    return np.asarray(np.linalg.norm(one.position_at(frames) - other.position_at(frames), axis=1))


def _distance_variance(one: TrackStretch, other: TrackStretch, frames: FloatArray) -> FloatArray:
    """(F,) variance of that distance, and of the one at which they touch (world units²)."""
    mine, others = (s.position_variance(frames, s.track.noise) for s in (one, other))
    return mine + others + REACH_NOISE_WORLD**2


def _exchange(mine: Sequence[TrackStretch], other: Sequence[TrackStretch], frame: float) -> tuple[float, float]:
    """Evidence against a lawful collision in how two objects change (nats), and the restitution that they show.

    The impulse on both is opposite, along the line from one to the other or nearly so, no larger than `MAX_RESTITUTION` allows,
    and without cubes, which turn, no smaller than objects need that stick together; the ratio of the masses is free within
    `MASS_RANGE`.
    """
    at = np.array([frame])
    p, q = mine[0].position_at(at)[0], other[0].position_at(at)[0]
    (before, after), (other_before, other_after) = ([s.velocity_at(at)[0] for s in pair] for pair in (mine, other))
    change, other_change = after - before, other_after - other_before
    variance, other_variance = (
        sum((s.velocity_variance(s.track.noise) for s in pair), VELOCITY_NOISE[pair[0].shape] ** 2)
        for pair in (mine, other)
    )
    away = (p - q) / max(float(np.hypot(*(p - q))), 1e-9)
    approach = before - other_before
    rotates = any(pair[0].shape == "cube" for pair in (mine, other))
    best = np.inf
    for ratio in MASS_RATIOS:
        # The impulse that explains both changes best, then the nearest one that is allowed.
        weight, other_weight = 1 / variance, ratio**2 / other_variance
        impulse = (weight * change - other_weight / ratio * other_change) / (weight + other_weight)
        size = float(np.hypot(*impulse))
        normal = impulse / size if size > 0 else away
        if normal @ away < MIN_ALONG:
            normal, size = away, max(float(impulse @ away), 0.0)
        # The direction of a small impulse is not well known, and so neither is how fast the objects approach along it.
        closing, across = -float(approach @ normal), float(np.hypot(*(approach - (approach @ normal) * normal)))
        off_by = 2 * across * min(float(min(variance, other_variance)) ** 0.5 / max(size, 1e-9), 1.0)
        least, most = (max(closing + sign * off_by, 0.0) / (1 + ratio) for sign in (-1, 1))
        size = min(max(size, 0.0 if rotates else least), (1 + MAX_RESTITUTION) * most)
        impulse = size * normal
        off, other_off = change - impulse, other_change + ratio * impulse
        best = min(best, float(off @ off) / (2 * variance) + float(other_off @ other_off) / (2 * other_variance))
    closing = -float(approach @ away)
    apart = float((after - other_after) @ away)
    return best, apart / max(closing, MIN_CLOSING_WORLD_PER_S)
