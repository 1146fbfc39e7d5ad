"""Evidence against the laws -> what a video breaks, and how probably."""

import math

from nsdr.laws.evidence import evidence_of
from nsdr.tracking.tracker import TrackerConfig, track
from nsdr.types import Judgement, VideoProposals, Violation
from nsdr.world.camera import CLEVRER_CAMERA, Camera

__all__ = ["judge"]

EVEN_NATS = {
    "permanence": 6.0,
    "identity": 6.0,
    "continuity": 13.9,
    "inertia": 19.0,
    "friction": 35.9,
    "solidity": 22.7,
    "reaction": 10.7,
    "distance": 6.0,
    "arrow": 21.5,
}
STEEPNESS = 1.8
"""Evidence against each law that makes its violation as probable as not (nats), and how fast the log odds grow with the
evidence's logarithm: of 631 lawful scenes of `train` and of training seeds, printed by `python benchmarks/violations.py SUITE
--lawful PROPOSALS_TRAIN.npz --every 24 --first 5 --fit`."""


def judge(
    proposals: VideoProposals, tracker: TrackerConfig | None = None, camera: Camera = CLEVRER_CAMERA
) -> Judgement:
    """Which laws of CLEVRER's world a video breaks, by which objects, and when.

    The tracks are explained by free sliding between contacts, with free masses and restitutions and the noise of positions as
    measured in the video, and by the same with a law broken; see `nsdr.laws.motion`. What is hidden, cut by the border or too
    short to tell is no evidence.

    Args:
        proposals: of the video's frames.
        tracker: thresholds of the tracker.
        camera: that took the video.

    Returns:
        The judgement. Where no object is seen, nothing is broken.
    """
    tracks = track(proposals, tracker, camera)
    violations, lawful = [], 1.0
    for e in evidence_of(tracks, proposals) if tracks.tracks else ():
        probability = 1 / (1 + math.exp(-STEEPNESS * math.log(e.nats / EVEN_NATS[e.law])))
        lawful *= 1 - probability
        if probability > 0.5:
            violations.append(Violation(*e[:-1], probability=probability))
    violations.sort(key=lambda v: (v.frame, v.law))
    return Judgement(tuple(t.object for t in tracks.tracks), proposals.n_frames, tuple(violations), 1 - lawful)
