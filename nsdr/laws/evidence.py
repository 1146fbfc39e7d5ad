"""All that speaks against the laws in a video: of motion, presence, and the direction of time."""

from dataclasses import replace
from typing import Any

import numpy as np

from nsdr.dynamics.motion_states import MotionStates, states_from_tracks
from nsdr.laws.breaks import MIN_EVIDENCE
from nsdr.laws.motion import Evidence, cut_motion, strongest
from nsdr.laws.presence import other_words, presence, renamed
from nsdr.laws.timing import Timing
from nsdr.types import VideoProposals, VideoTracks


def evidence_of(tracks: VideoTracks, proposals: VideoProposals | None = None) -> list[Evidence]:
    """What speaks against each law in a video, the strongest evidence first; nothing where no object is seen.

    What explains other evidence takes its place: an object that turns up where another one disappears, and for all that
    speaks against the laws of motion, that the video makes more sense backwards.

    Args:
        tracks: of the video.
        proposals: from which they were made; None says nothing of words that change in a track.
    """
    if not tracks.tracks:
        return []
    states = states_from_tracks(tracks)
    processed = np.ones(tracks.n_frames, bool)
    if proposals is not None and proposals.processed is not None:
        processed = np.isin(np.arange(tracks.n_frames), proposals.processed)
    forwards = cut_motion(states)
    motion, found = list(forwards.motion()), presence(forwards, processed)
    if proposals is not None:
        found = renamed(found, tracks, proposals, processed)
        found += other_words(forwards, tracks, proposals)
    # That the ground is another one, too, would be a second broken law.
    backwards = cut_motion(_reversed(states), forwards.noise, known_ground=True)
    gain = forwards.cost() - backwards.cost()
    if gain > MIN_EVIDENCE:
        every = tuple(range(len(states.objects)))
        motion = [Evidence("arrow", every, 0, tracks.n_frames, gain, "nats", gain)]
    return strongest([*motion, *found])


def evidence_in_time(tracks: VideoTracks, timing: Timing, proposals: VideoProposals | None = None) -> list[Evidence]:
    """The evidence of `evidence_of` with frames at their own times, and that of standstills.

    Frame numbers are those of the video.
    """
    found = evidence_of(timing.tracks(tracks), None if proposals is None else timing.proposals(proposals))
    return [*(timing.as_shown(e) for e in found), *timing.evidence]


def _reversed(states: MotionStates) -> MotionStates:
    """The tracks of the video played backwards."""
    names = ("location_world", "detected", "reliable", "present", "box_px")
    turned: dict[str, Any] = {name: np.ascontiguousarray(getattr(states, name)[:, ::-1]) for name in names}
    return replace(states, **turned)
