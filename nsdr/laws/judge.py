"""The judgement of a video: which laws it breaks, with probabilities computed from the evidence."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from nsdr.errors import VideoError
from nsdr.laws.evidence import evidence_in_time, processed_frames
from nsdr.laws.motion import Evidence
from nsdr.laws.timing import timing_of
from nsdr.tracking.tracker import TrackerConfig, track
from nsdr.types import Judgement, VideoProposals, VideoTracks, Violation
from nsdr.validation import FloatArray, IntArray
from nsdr.world.world import World

EVEN_NATS = {
    "permanence": 6.0,
    "identity": 6.0,
    "continuity": 16.1,
    "inertia": 22.2,
    "friction": 43.2,
    "solidity": 23.1,
    "reaction": 11.6,
    "distance": 6.0,
    "arrow": 6.0,
    "standstill": 10.0,
}
STEEPNESS = 3.3
"""Evidence against each law at which a violation has probability 0.5 (nats), and the slope of the log-odds as a function of the
logarithm of the evidence. They are the same in each world: evidence is the logarithm of a ratio of likelihoods, in which
lengths are relative to their noise, and has no unit. Fitted to 501 lawful scenes of `train` and to suites with training seeds
by `python -m benchmarks.violations SUITE… --lawful PROPOSALS_TRAIN.npz --every 24 --first 5 --fit` (docs/judge.md says how the
suites were made)."""
MIN_JUDGED_FRAMES, MAX_SPACING_FRAMES = 24, 3
"""Smallest number of frames that are judged, and their largest spacing (frames of CLEVRER; in other worlds as long). In fewer
frames, few violations are found; at a larger spacing, lawful videos seem to break laws (`python -m benchmarks.violations SUITE
--lawful PROPOSALS_VALIDATION.npz --rates`)."""
SAFE_SPACING_FRAMES = 2
"""At a larger spacing, judgements have a note (frames of CLEVRER; in other worlds as long). Of 48 lawful videos (34 of `train`,
every 260th from scene 5 on, originals and clips), one seems to break a law at a stride of 2, and one at 3; of the 37 in
docs/judge.md, none at 2 and two at 3."""


def judge_proposals(
    proposals: VideoProposals,
    tracker: TrackerConfig | None = None,
    late: FloatArray | None = None,
) -> Judgement:
    """Judge which laws of its world a video breaks, which objects break them, and when.

    The tracks are explained by lawful motion (free sliding between contacts, with masses and restitutions in the world's range
    and the noise of positions measured in the video) and by motion that breaks a law; see `nsdr.laws.motion`. Motion that is
    hidden, cut by the image border or short gives little or no evidence.

    Frames are judged at the times at which they were taken. If a copy at another rate left out frames or repeats them,
    `Judgement.notes` says so; see `nsdr.laws.timing`.

    Args:
        proposals: proposals in the frames of the video.
        tracker: thresholds of the tracker.
        late: (F,) delay of each frame relative to a video at the world's frame rate (frames), not 0 for videos at another rate;
            None for no delays.

    Returns:
        The judgement. It has no violations if no object is seen.

    Raises:
        VideoError: too few frames were processed, or their spacing is too large.
    """
    return judge_tracks(track(proposals, tracker), proposals, late)


def judge_tracks(
    tracks: VideoTracks, proposals: VideoProposals | None = None, late: FloatArray | None = None
) -> Judgement:
    """Judge a video as `judge_proposals` does, by its tracks.

    Args:
        tracks: tracks of the video.
        proposals: proposals from which the tracks were made; None for tracks from elsewhere, whose objects keep their words.
        late: (F,) delays of the frames, as in `judge_proposals`.
    """
    processed = processed_frames(tracks, proposals)
    world = tracks.world
    _spacing(processed, world)
    timing = timing_of(tracks, processed, np.zeros(tracks.n_frames) if late is None else late)
    spacing = _spacing(timing.slots, world)
    found = judgement_of(tracks, evidence_in_time(tracks, timing, proposals))
    return replace(found, notes=(*found.notes, *timing.notes, *spacing_notes(spacing, world)))


def spacing_notes(spacing_frames: float, world: World) -> tuple[str, ...]:
    """Notes on a judgement of frames with a large spacing; empty if there is nothing to say."""
    if spacing_frames <= SAFE_SPACING_FRAMES * world.scales.rate:
        return ()
    rate = world.timeline.fps / spacing_frames
    return (f"{rate:.3g} frames a second are few: about one lawful video in thirty seems to break a law",)


def judgement_of(tracks: VideoTracks, evidence: Iterable[Evidence]) -> Judgement:
    """Compute the probabilities of violations from the evidence of `nsdr.laws.evidence`.

    The log-odds of a violation are `STEEPNESS` · log(nats / `EVEN_NATS`).
    """
    violations, lawful = [], 1.0
    for e in evidence:
        probability = 1 / (1 + (EVEN_NATS[e.law] / e.nats) ** STEEPNESS)
        lawful *= 1 - probability
        if probability > 0.5:
            violations.append(Violation(*e[:6], probability=probability, looks=e.looks))
    violations.sort(key=lambda v: (v.frame, v.law))
    objects = tuple(t.object for t in tracks.tracks)
    return Judgement(objects, tracks.n_frames, tuple(violations), 1 - lawful, tracks.notes)


def _spacing(frames: IntArray, world: World) -> float:
    """Median number of frames from one processed frame to the next.

    Raises:
        VideoError: there are too few, or their spacing is too large.
    """
    if len(frames) < MIN_JUDGED_FRAMES:
        raise VideoError(f"{len(frames)} different frames are too few to judge; expected {MIN_JUDGED_FRAMES} or more")
    spacing = float(np.median(np.diff(frames)))
    if spacing > (most := max(MAX_SPACING_FRAMES * world.scales.rate, 1)):  # a world's own rate is enough
        fps = world.timeline.fps
        least = f"expected {fps / most:.0f} or more, and a stride of no more than {int(most)}"
        raise VideoError(f"{fps / spacing:.3g} frames a second are too few to judge; {least}")
    return spacing
