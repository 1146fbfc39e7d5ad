"""The data types that stages exchange. All are frozen dataclasses, validated on construction.

video -> `VideoProposals` -> `VideoTracks` -> `DynamicsPrediction` -> `Scene` -> `Answer`;
`VideoTracks` + interventions -> `Simulation`; `VideoProposals` -> `Judgement`

Frames count from 0; the video shows frames below `n_frames`, later ones are unseen. Pixels are those of the 480x320
image, (column, row); world units are CLEVRER's ground plane (x towards the camera, y to the right of the image).

Arrays are stored as read-only views of the arrays passed in.
"""

from nsdr.types.answers import Answer, ChoiceAnswer, TraceStep
from nsdr.types.events import Event
from nsdr.types.interventions import Add, Freeze, Move, Remove, SetMass, SetVelocity
from nsdr.types.judgements import LAWS, Judgement, Violation
from nsdr.types.scenes import DynamicsPrediction, ObjectPhysics, Rollout, Scene, UncertainEvent
from nsdr.types.simulations import EventChange, Simulation
from nsdr.types.tracks import Camera, SceneObject, Track, VideoProposals, VideoTracks

__all__ = [
    "LAWS",
    "Add",
    "Answer",
    "Camera",
    "ChoiceAnswer",
    "DynamicsPrediction",
    "Event",
    "EventChange",
    "Freeze",
    "Judgement",
    "Move",
    "ObjectPhysics",
    "Remove",
    "Rollout",
    "Scene",
    "SceneObject",
    "SetMass",
    "SetVelocity",
    "Simulation",
    "TraceStep",
    "Track",
    "UncertainEvent",
    "VideoProposals",
    "VideoTracks",
    "Violation",
]
