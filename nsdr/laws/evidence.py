"""What speaks against each law: how much worse the tracks fit lawful motion than motion that breaks it once, in nats.

A lawful object slides freely between its contacts (`nsdr.laws.stretches`). So each change of motion needs a contact, in which
both objects change as masses and restitution allow; objects that meet need to change; and what is not seen needs a reason.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, takewhile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.laws.stretches import SURE_FRAMES, VELOCITY_NOISE, Break, ObjectStretches, Stretch, noise_of
from nsdr.tracking.localization import outline
from nsdr.tracking.visibility import in_image
from nsdr.types import VideoProposals, VideoTracks
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX, on_ground
from nsdr.world.physics_constants import MASS_RANGE, OBJECT_RADIUS_WORLD
from nsdr.world.vocabulary import ATTRIBUTES, attributes_of

__all__ = ["Evidence", "Explanation", "evidence_of"]

FloatArray = NDArray[np.floating[Any]]
CORNER_WORLD = 0.07
"""How much farther a cube's edges reach than its sides (world units)."""
REACH_NOISE_WORLD = 0.01
"""Standard deviation of the distance at which two objects touch (world units)."""
SAME_FRAMES = 3
"""Two objects that change within so many frames may do so in one contact."""
UNSEEN_FRAMES = 10
"""Objects may touch so long before they are first seen, or after they are last seen (frames)."""
CROWDED_FRAMES, CROWDED_WORLD = 14, 1.2
"""Other changes so near to a contact make its effect unknown (frames, world units)."""
JUMP_FRAMES = 6
"""An object that is hidden for longer may have been hit twice, so that its place tells nothing (frames)."""
HIDDEN_FRAMES = 24
"""Changes during which an object is hidden for longer do not show the effect of one contact alone (frames)."""
CONTACT_COST, TOUCH_NATS = 12.0, 4.0
"""Contacts against which more speaks explain nothing; pairs against whose contact less speaks touch (nats)."""
MIN_EVIDENCE = 4.0
"""Less evidence is not reported (nats)."""
SEEN_MARGIN_PX, COVERED_SHARE = 8.0, 0.3
"""An object should be seen when its outline is so far inside the image, and nearer objects cover less than this of its box."""
MAX_UNKNOWN_WORLD = 0.15
"""Where an object is that is not seen must be known as well (standard deviation, world units)."""
MIN_EXTRA = 0.08
"""Smaller differences of the deceleration are those of the fit, where an object comes to rest (world units/s²)."""
SPIN_RELIEF = {"cube": 0.2, "cylinder": 0.2, "sphere": MIN_EXTRA}
"""So much less slows down an object that spins, as friction acts against both motions (world units/s²)."""
MISSED_NATS = 2.0
"""Evidence of each frame in which an object should be seen, but is not, or has another word."""
MASS_RATIOS = np.geomspace(MASS_RANGE[0] / MASS_RANGE[1], MASS_RANGE[1] / MASS_RANGE[0], 15)
MAX_RESTITUTION = 0.8
"""Largest restitution that a collision may show; CLEVRER's is 0.64, and up to 0.76 was measured in official proposals."""
MIN_CLOSING_WORLD_PER_S = 0.05
"""Speeds of approach that restitutions are divided by are at least this (world units/s)."""
MIN_ALONG = 0.6
"""Least cosine between an impulse and the line from one object to the other: cubes push along their sides."""
CAUSE_FRAMES = 6
"""Weaker evidence about an object so near to other evidence is explained by it (frames)."""
PLACE_WORLD = 0.3
"""An object that turns up as near to the place of one that disappears takes its place (world units)."""


class Evidence(NamedTuple):
    """What speaks for one violation: as `nsdr.types.Violation`, with nats in place of a probability."""

    law: str
    objects: tuple[int, ...]
    frame: int
    end: int
    amount: float
    unit: str
    nats: float


@dataclass
class Explanation:
    """The motion of a video's objects, and what in it is against the laws.

    Args:
        states: the tracks.
        processed: (F,) bool, the frames that were looked at.
        noise: standard deviation of their positions; None to measure it.
    """

    states: MotionStates
    processed: NDArray[np.bool_]
    noise: float | None = None

    def __post_init__(self) -> None:
        every = range(len(self.states.objects))
        if self.noise is None:
            self.noise = noise_of(s for i in every for s in ObjectStretches(self.states, i).stretches())
        objects = [ObjectStretches(self.states, i, self.noise) for i in every]
        self.frames = self.states.present.shape[1]
        self._cut([o.stretches() for o in objects])
        for one in objects:
            one.merge(lambda b: min((c.nats for c in self._contacts(b)), default=np.inf) < CONTACT_COST)
        self._cut([o.stretches() for o in objects])

    def _cut(self, stretches: list[list[Stretch]]) -> None:
        self.stretches = stretches
        self.breaks = [[Break(a, b) for a, b in pairwise(one)] for one in stretches]

    def motion(self) -> Iterator[Evidence]:
        """Against the laws of motion."""
        yield from self._friction()
        yield from self._changes()
        yield from self._solidity()

    def cost(self) -> float:
        """Of the positions and of all that is against the laws of motion (nats)."""
        fit = sum(s.cost for one in self.stretches for s in one)
        return fit + sum(e.nats for e in self.motion())

    def _friction(self) -> Iterator[Evidence]:
        for s in (s for one in self.stretches for s in one):
            if s.gain > MIN_EVIDENCE and not -SPIN_RELIEF[s.shape] < s.extra < MIN_EXTRA:
                yield Evidence("friction", (s.track.i,), s.onset(), s.last + 1, s.extra, "world units/s²", s.gain)

    def _changes(self) -> Iterator[Evidence]:
        """Against continuity, inertia, reaction and action at a distance alone: changes of motion without a good reason."""
        for b in (b for one in self.breaks for b in one):
            if not b.is_sure:
                continue
            jump, kick = b.jump(), b.kick()
            frame = round(b.frame)
            if jump.nats > kick.nats:
                if jump.nats > MIN_EVIDENCE and b.hidden_frames <= JUMP_FRAMES:
                    yield Evidence("continuity", (b.i,), frame, frame + 1, jump.size, "world units", jump.nats)
                continue
            contacts = self._contacts(b)
            lawful = min((c.nats for c in contacts), default=np.inf)
            nats = min(kick.nats, lawful, self._unseen_nats(b))
            if nats < MIN_EVIDENCE:
                continue
            touching = [c for c in contacts if c.gap_nats < TOUCH_NATS and c.exchange_nats is not None]
            apart = [c for c in contacts if c.opposite and (c.exchange_nats or 0.0) < c.gap_nats]
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

    def at(self, j: int, frame: float) -> Stretch | None:
        """The stretch of object j that a frame is in, or nearest to."""
        near = [s for s in self.stretches[j] if s.start - SAME_FRAMES <= frame <= s.last + SAME_FRAMES]
        return min(near, key=lambda s: max(s.start - frame, frame - s.last), default=None)

    def _sides(self, j: int, frame: float) -> tuple[Stretch, Stretch] | None:
        """Object j's motion before and after a frame: of two stretches, or of the parts of one; None where too little is
        seen."""
        for b in self.breaks[j]:
            if abs(b.frame - frame) <= SAME_FRAMES:
                return b.before, b.after
        s = self.at(j, frame)
        return None if s is None else s.parts(frame)

    def _contacts(self, b: Break) -> "list[_Contact]":
        """Contacts with each other object that is seen around a change of motion."""
        found = [self._contact(b, j) for j in range(len(self.stretches)) if j != b.i]
        return [c for c in found if c is not None]

    def _contact(self, b: Break, j: int) -> "_Contact | None":
        """How well a contact with object j explains a change of motion; None where j is not seen around it."""
        frame, when = b.frame, b.window
        near = [
            s for s in self.stretches[j] if s.start - UNSEEN_FRAMES <= when[-1] and when[0] <= s.last + UNSEEN_FRAMES
        ]
        if not near:
            return None
        gap, nats = np.inf, np.inf
        reach = 2 * OBJECT_RADIUS_WORLD + CORNER_WORLD * sum(s.shape == "cube" for s in (b.before, near[0]))
        for one in (b.before, b.after):
            for other in near:
                gaps = np.maximum(_distance(one, other, when) - reach, 0.0)
                found = gaps**2 / (2 * _distance_variance(one, other, when))
                if found.min() < nats:
                    gap, nats = float(gaps[found.argmin()]), float(found.min())
        others = [o for o in self.breaks[j] if abs(o.frame - frame) <= SAME_FRAMES]
        sides = self._sides(j, frame)
        exchange, restitution = None, np.nan
        if sides is not None and not self._is_crowded(b, j):
            # What is hidden for long may have changed twice.
            hidden = [o.hidden_frames for o in (b, *others)]
            if max(hidden) <= HIDDEN_FRAMES and all(len(s) >= SURE_FRAMES for s in (b.before, b.after, *sides)):
                exchange, restitution = _exchange((b.before, b.after), sides, frame)
        opposite = any(float(b.change @ o.change) < -MIN_ALONG * b.kick().size * o.kick().size for o in others)
        return _Contact(j, gap, nats, exchange, restitution, opposite)

    def _is_crowded(self, b: Break, j: int) -> bool:
        """Whether more happens around a contact than that of the two objects, so that its effect alone is not seen."""
        frame = b.frame
        for k, breaks in enumerate(self.breaks):
            for other in breaks:
                since = abs(other.frame - frame)
                if other.is_slight:
                    continue
                if k in (b.i, j):
                    if SAME_FRAMES < since <= CROWDED_FRAMES:
                        return True
                elif since <= CROWDED_FRAMES and np.hypot(*(other.place - b.place)) < CROWDED_WORLD:
                    return True
        return False

    def _unseen_nats(self, b: Break) -> float:
        """Of the explanation that an object hit it that is not in the image."""
        other = b.place - 2 * OBJECT_RADIUS_WORLD * b.change / max(float(np.hypot(*b.change)), 1e-9)
        near = in_image("sphere", on_ground(other[None]), np.zeros(1), self.states.camera)[0]
        return np.inf if near else 0.0

    def _solidity(self) -> Iterator[Evidence]:
        """Against solidity: objects that are nearer to each other than they can be."""
        for i, mine in enumerate(self.stretches):
            for j in range(i):
                found = [self._overlap(one, other) for one in mine for other in self.stretches[j]]
                best = max((e for e in found if e is not None), key=lambda e: e.nats, default=None)
                if best is not None and best.nats > MIN_EVIDENCE:
                    yield best

    def _overlap(self, one: Stretch, other: Stretch) -> Evidence | None:
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

    def permanence(self) -> Iterator[Evidence]:
        """Against permanence: frames in which an object should be seen."""
        for i in range(len(self.stretches)):
            seen = np.flatnonzero(self.states.detected[i])
            gaps = [
                (0, int(seen[0])),
                *((int(a) + 1, int(b)) for a, b in pairwise(seen)),
                (int(seen[-1]) + 1, self.frames),
            ]
            for start, end in gaps:
                # Counted from where it was seen: a place at the border or behind another object is a reason.
                order = range(end - 1, -1, -1) if start == 0 else range(start, end)
                missed = list(takewhile(partial(self._should_be_seen, i), (f for f in order if self.processed[f])))
                nats = len(missed) * MISSED_NATS * self.states.spacing_frames
                if nats > MIN_EVIDENCE:
                    first, last = (min(end, self.frames - 1), end) if start == 0 else (missed[0], missed[-1] + 1)
                    yield Evidence("permanence", (i,), first, last, abs(missed[-1] - missed[0]) + 1, "frames", nats)

    def _should_be_seen(self, i: int, frame: int) -> bool:
        near = min(self.stretches[i], key=lambda s: max(s.start - frame, frame - s.last))
        at = np.array([frame])
        place = near.place(at)[0]
        if near.place_variance(at)[0] > MAX_UNKNOWN_WORLD**2:
            return False
        shape = self.states.objects[i].shape
        if not in_image(shape, on_ground(place[None]), np.zeros(1), self.states.camera)[0]:
            return False
        polygon = outline(shape, float(place[0]), float(place[1]), camera=self.states.camera)
        low, high = polygon.min(0), polygon.max(0)
        if (low < SEEN_MARGIN_PX).any() or (high > np.array([WIDTH_PX, HEIGHT_PX]) - SEEN_MARGIN_PX).any():
            return False
        covered = 0.0
        for j in range(len(self.stretches)):
            if j != i and self.states.present[j, frame]:
                x0, y0, x1, y1 = self.states.box_xyxy_px[j, frame]
                if y1 > high[1] - 2:  # nearer
                    width, height = min(x1, high[0]) - max(x0, low[0]), min(y1, high[1]) - max(y0, low[1])
                    covered += max(width, 0.0) * max(height, 0.0) / float(np.prod(high - low))
        return covered < COVERED_SHARE


class _Contact(NamedTuple):
    """How well a contact explains a change of motion.

    Attributes:
        j: the other object.
        gap: between the two (world units).
        gap_nats: of the gap.
        exchange_nats: of how both change; None where that is not seen.
        restitution: speed of separation over speed of approach.
        opposite: the other one changes at the same time, in the opposite direction.
    """

    j: int
    gap: float
    gap_nats: float
    exchange_nats: float | None
    restitution: float
    opposite: bool

    @property
    def nats(self) -> float:
        """Against the contact as the reason."""
        return self.gap_nats + (self.exchange_nats or 0.0)


def _distance(one: Stretch, other: Stretch, frames: FloatArray) -> FloatArray:
    """(F,) between the centres of two objects (world units)."""
    return np.asarray(np.linalg.norm(one.place(frames) - other.place(frames), axis=1))


def _distance_variance(one: Stretch, other: Stretch, frames: FloatArray) -> FloatArray:
    """(F,) of that, and of the distance at which they touch."""
    return one.place_variance(frames) + other.place_variance(frames) + REACH_NOISE_WORLD**2


def _exchange(mine: Sequence[Stretch], other: Sequence[Stretch], frame: float) -> tuple[float, float]:
    """Evidence against a lawful collision in how two objects change (nats), and the restitution that they show.

    The impulse on both is opposite, along the line from one to the other or nearly so, and no larger than `MAX_RESTITUTION`
    allows; the ratio of the masses is free within `MASS_RANGE`.
    """
    at = np.array([frame])
    p, q = mine[0].place(at)[0], other[0].place(at)[0]
    (before, after), (other_before, other_after) = ([s.velocity(frame) for s in pair] for pair in (mine, other))
    change, other_change = after - before, other_after - other_before
    variance, other_variance = (
        a.velocity_variance + b.velocity_variance + VELOCITY_NOISE[a.shape] ** 2 for a, b in (mine, other)
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


def evidence_of(tracks: VideoTracks, proposals: VideoProposals | None = None) -> list[Evidence]:
    """What speaks against each law in a video, the strongest evidence first.

    What explains other evidence takes its place: an object that turns up where another one disappears, or a video that makes
    more sense backwards.

    Args:
        tracks: of the video.
        proposals: from which they were made; None says nothing of words that change in a track.
    """
    states = states_from_tracks(tracks)
    processed = np.ones(tracks.n_frames, bool)
    if proposals is not None and proposals.processed is not None:
        processed = np.isin(np.arange(tracks.n_frames), proposals.processed)
    forwards = Explanation(states, processed)
    found = [*forwards.motion(), *_replaced(forwards, list(forwards.permanence()))]
    if proposals is not None:
        found += _other_words(forwards, tracks, proposals)
    backwards = Explanation(_reversed(states), processed[::-1], forwards.noise)
    gain = forwards.cost() - backwards.cost()
    if gain > MIN_EVIDENCE:
        every = tuple(range(len(states.objects)))
        found.append(Evidence("arrow", every, 0, tracks.n_frames, gain, "nats", gain))
    return _strongest(found)


def _strongest(found: list[Evidence]) -> list[Evidence]:
    """The evidence without what stronger one near it explains."""
    kept: list[Evidence] = []
    for e in sorted(found, key=lambda e: -e.nats):
        explained = any(
            set(e.objects) & set(k.objects) and k.frame - CAUSE_FRAMES <= e.frame <= k.end + CAUSE_FRAMES for k in kept
        )
        if not explained:
            kept.append(e)
    return kept


def _replaced(explanation: Explanation, found: list[Evidence]) -> list[Evidence]:
    """Evidence against permanence; where one object takes another one's place, against identity."""
    objects, seen = explanation.states.objects, explanation.states.detected
    result, used = [], set()
    for new, one in enumerate(explanation.stretches):
        start = one[0].start
        for old in range(len(objects)):
            near = explanation.at(old, start)
            if old == new or start == 0 or near is None or seen[old, start : start + SAME_FRAMES].any():
                continue
            if np.hypot(*(near.place(np.array([start])) - one[0].place(np.array([start])))[0]) < PLACE_WORLD:
                both = [e for e in found if e.objects in ((old,), (new,)) and e.frame - SAME_FRAMES <= start <= e.end]
                if both:
                    words = sum(getattr(objects[old], w) != getattr(objects[new], w) for w in ATTRIBUTES)
                    nats = sum(e.nats for e in both)
                    end = int(one[-1].last) + 1
                    result.append(Evidence("identity", (old, new), start, end, words, "words", nats))
                    used |= set(both)
    return result + [e for e in found if e not in used]


def _other_words(explanation: Explanation, tracks: VideoTracks, proposals: VideoProposals) -> Iterator[Evidence]:
    """Against identity: reliable frames in a row in which an object has another word than in most."""
    words = {
        (int(f), *c): attributes_of(int(a))
        for f, c, a in zip(proposals.frame_index, proposals.centroid_px.tolist(), proposals.attribute, strict=True)
    }
    for t in tracks.tracks:
        rows = [words.get((int(f), *c)) for f, c in zip(t.frame_index, t.centroid_px.tolist(), strict=True)]
        name = (t.object.color, t.object.material, t.object.shape)
        reliable = explanation.states.reliable[t.object.id, t.frame_index]
        run: list[tuple[int, int]] = []
        best: list[tuple[int, int]] = []
        for f, row, good in zip(t.frame_index.tolist(), rows, reliable, strict=True):
            if row is None or row == name:
                run = []
            elif good:
                run = [*run, (f, sum(a != b for a, b in zip(row, name, strict=True)))]
                best = max(best, run, key=len)
        nats = len(best) * MISSED_NATS * explanation.states.spacing_frames
        if nats > MIN_EVIDENCE:
            count = max(n for _, n in best)
            yield Evidence("identity", (t.object.id,), best[0][0], best[-1][0] + 1, count, "words", nats)


def _reversed(states: MotionStates) -> MotionStates:
    """The tracks of the video played backwards."""
    names = ("location_world", "detected", "reliable", "present", "box_px")
    turned: dict[str, Any] = {name: np.ascontiguousarray(getattr(states, name)[:, ::-1]) for name in names}
    return replace(states, **turned)
