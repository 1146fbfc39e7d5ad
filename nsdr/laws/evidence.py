"""All evidence against the laws in a video: motion, presence, and the direction of time."""

from dataclasses import replace
from typing import Any

import numpy as np

from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.laws.breaks import MIN_EVIDENCE
from nsdr.laws.motion import Evidence, cut_motion, strongest
from nsdr.laws.presence import other_words, presence, renamed
from nsdr.laws.timing import Timing
from nsdr.types import VideoProposals, VideoTracks
from nsdr.validation import IntArray


def evidence_of(tracks: VideoTracks, proposals: VideoProposals | None = None) -> list[Evidence]:
    """Find the evidence against each law in a video, the strongest first. There is none if no object is seen.

    Evidence that explains other evidence replaces it. If one object appears where another disappears, their evidence against
    permanence becomes evidence against identity. If the video is more plausible backwards, all evidence against the laws of
    motion becomes evidence against the arrow of time.

    Args:
        tracks: tracks of the video.
        proposals: proposals from which the tracks were made; None leaves out attributes that change within a track.
    """
    if not tracks.tracks:
        return []
    states = states_from_tracks(tracks)
    processed = np.isin(np.arange(tracks.n_frames), processed_frames(tracks, proposals))
    forwards = cut_motion(states)
    motion, found = list(forwards.motion()), presence(forwards, processed)
    if proposals is not None:
        found = renamed(found, tracks, proposals, processed)
        found += other_words(forwards, tracks, proposals)
    # Another ground in the reversed video would be a second broken law.
    backwards = cut_motion(_reversed(states), forwards.noise, known_ground=True)
    gain = forwards.cost() - backwards.cost()
    if gain > MIN_EVIDENCE:
        every = tuple(range(len(states.objects)))
        motion = [Evidence("arrow", every, 0, tracks.n_frames, gain, "nats", gain)]
    return strongest([*motion, *found])


def processed_frames(tracks: VideoTracks, proposals: VideoProposals | None = None) -> IntArray:
    """The (P,) frames in which objects were looked for.

    Tracks alone do not say which. All frames are assumed, or, if detections are further apart than one frame, those with a
    detection of any object.
    """
    if proposals is not None:
        return np.arange(proposals.n_frames) if proposals.processed is None else proposals.processed
    seen = np.unique(np.concatenate([np.zeros(0, int), *(t.frame_index for t in tracks.tracks)]))
    return seen if len(seen) > 1 and np.median(np.diff(seen)) > 1 else np.arange(tracks.n_frames)


def evidence_in_time(tracks: VideoTracks, timing: Timing, proposals: VideoProposals | None = None) -> list[Evidence]:
    """Find the evidence with each frame at the time at which it was taken, including evidence of standstills.

    Args:
        tracks: tracks of the video.
        timing: times at which the frames were taken.
        proposals: proposals from which the tracks were made; None as in `evidence_of`.

    Returns:
        The evidence, with frame numbers of the video.
    """
    found = evidence_of(timing.tracks(tracks), None if proposals is None else timing.proposals(proposals))
    return [*(timing.as_shown(e) for e in found), *timing.evidence]


def _reversed(states: MotionStates) -> MotionStates:
    """The motion states of the video played backwards."""
    names = ("location_world", "detected", "reliable", "present", "box_px")
    turned: dict[str, Any] = {name: np.ascontiguousarray(getattr(states, name)[:, ::-1]) for name in names}
    return replace(states, **turned)
