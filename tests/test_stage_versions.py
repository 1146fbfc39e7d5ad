"""The results of stages that are kept: they change only together with the `VERSION` of the stage's folder.

`python -m tests.test_stage_versions` stores new results, after the versions of the stages that changed were raised.
"""

import importlib
import json
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import nsdr
from nsdr.baselines.features.extraction import FeatureExtractor
from nsdr.baselines.features.files import FeatureConfig
from nsdr.clevrer.example import QUESTIONS, TRUTH, VIDEO
from nsdr.clevrer.files.questions import read_questions
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.dynamics.velocity_events import collisions_from_motion
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.render.preview import render_preview
from nsdr.generate.render.view import View
from nsdr.generate.scene_files import solids_at
from nsdr.io.video import read_frames
from nsdr.laws.judge import judge_proposals
from nsdr.types import Event
from nsdr.world.camera import CLEVRER_CAMERA, Camera
from nsdr.world.world import CLEVRER_WORLD

STORED = Path(__file__).with_name("stage_versions.json")
TOLERANCE = {int: 1, float: 0.03}
"""Of frames, pixels and numbers of things; of positions (world units), scores and probabilities, between processors."""


@cache
def _perception() -> Any:
    return nsdr.Pipeline.from_pretrained(device="cpu").perceive(VIDEO)


def _events(events: tuple[Event, ...]) -> list[Any]:
    return [[event.kind, event.frame, *event.objects] for event in events]


def _places(location: Any, frames: tuple[int, ...]) -> list[Any]:
    return [[round(float(v), 2) for v in path[f]] for path in location for f in frames if np.isfinite(path[f]).all()]


def _frame_parser() -> Any:
    found = _perception().proposals
    rows = range(0, len(found.frame_index), 50)
    return [[int(found.attribute[i]), round(float(found.score[i]), 2), *found.box_xyxy_px[i].tolist()] for i in rows]


def _tracking() -> Any:
    tracks = _perception().tracks.tracks
    return [[t.object.name, len(t.frame_index), *_places([t.location_world], (0, -1))] for t in tracks]


def _laws() -> Any:
    """Of the clip, in which an object vanishes."""
    seen = _perception().proposals
    kept = (seen.attribute != seen.attribute[0]) | (seen.frame_index < 40)
    names = ("frame_index", "attribute", "score", "centroid_px", "area_px", "box_xyxy_px")
    found = judge_proposals(nsdr.VideoProposals(seen.n_frames, *(getattr(seen, name)[kept] for name in names)))
    return [[v.law, v.frame, v.end, round(v.probability, 2), *v.objects] for v in found.violations]


def _physics() -> Any:
    """Of collisions after the video the pairs: their frames depend on the processor."""
    made = _perception().explanation.prediction
    rollouts = [made.observed, *(made.counterfactual[k] for k in sorted(made.counterfactual))]
    collisions = [[[min(e.frame, CLEVRER_WORLD.timeline.frames), *e.objects] for e in r.collisions] for r in rollouts]
    return [collisions, _places(made.observed.location_world, (0, 60, 120))]


def _propnet() -> Any:
    made = nsdr.PropNetPredictor.from_pretrained(device="cpu").explain(
        nsdr.dynamics.states_from_tracks(_perception().tracks)
    )
    return [_events(made.observed.collisions), _places(made.observed.location_world, (0, 60, 120))]


def _dynamics() -> Any:
    made = _perception().explanation.prediction
    scene = scene_from_prediction(made)
    by_velocity = collisions_from_motion(made.observed, CLEVRER_CAMERA)
    return [
        [o.name for o in scene.objects],
        _events(scene.events),
        _events(scene.predicted or ()),
        _events(by_velocity),
    ]


def _texts() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Text, its kind, and its program."""
    for question in read_questions(QUESTIONS)[0].questions:
        yield question.text, "multiple_choice" if question.choices else "descriptive", question.program
        yield from ((choice.text, "choice", choice.program) for choice in question.choices)


def _question_parser() -> Any:
    parser = nsdr.QuestionParser.from_pretrained(device="cpu")
    return [" ".join(parser.parse(text, kind).tokens) for text, kind, _ in _texts()]


def _symbolic() -> Any:
    executor = nsdr.Executor(nsdr.load(TRUTH))
    return [executor.answer(program).text for _, kind, program in _texts() if kind == "descriptive"]


def _generate() -> Any:
    scene = simulate_scene(1)
    contacts = [[c.frame, *c.bodies] for c in scene.motion.contacts]
    picture = render_preview(scene.objects, solids_at(scene, 60), View(Camera(width=96, height=64)))
    brightness = picture.reshape(4, 16, 6, 16, 3).mean((1, 3, 4)).ravel().round(1).tolist()
    return [[o.name for o in scene.objects], contacts, _places(scene.motion.location_world, (0, 60, 120)), brightness]


def _features() -> Any:
    config = FeatureConfig("frame_parser", 2, (320, 480), (2, 3), (1, 1), kinds=("pooled",), precision="float32")
    pooled = FeatureExtractor(config, "cpu")(list(read_frames(VIDEO)))["pooled"]
    return [round(float(v), 2) for v in pooled[:, ::20].ravel()]


STAGES: dict[str, Callable[[], Any]] = {
    "frame_parser": _frame_parser,
    "tracking": _tracking,
    "laws": _laws,
    "dynamics": _dynamics,
    "dynamics.physics": _physics,
    "dynamics.propnet": _propnet,
    "question_parser": _question_parser,
    "symbolic": _symbolic,
    "baselines.features": _features,
    "generate": _generate,
}


def _alike(found: Any, stored: Any) -> bool:
    if isinstance(stored, list | dict):
        pairs = (
            zip(found, stored, strict=True) if isinstance(stored, list) else ((found.get(k), stored[k]) for k in stored)
        )
        return isinstance(found, type(stored)) and len(found) == len(stored) and all(_alike(*pair) for pair in pairs)
    if type(stored) in TOLERANCE and type(found) in TOLERANCE:
        return abs(found - stored) <= TOLERANCE[type(stored)]
    return bool(found == stored)


@pytest.mark.parametrize("stage", STAGES)
def test_a_stages_results_are_those_of_its_version(stage: str) -> None:
    stored = json.loads(STORED.read_text())[stage]
    found, version = json.loads(json.dumps(STAGES[stage]())), importlib.import_module(f"nsdr.{stage}").VERSION
    remedy = "run `python -m tests.test_stage_versions`, which stores the new results"
    if version == stored["version"]:
        assert _alike(found, stored["result"]), (
            f"the results of nsdr.{stage} changed, so what users keep is stale: if that is meant, raise VERSION in "
            f"nsdr/{stage.replace('.', '/')}/__init__.py and {remedy}; found {found}"
        )
    assert version == stored["version"], f"VERSION of nsdr.{stage} was raised: {remedy}"


if __name__ == "__main__":
    results = {
        s: {"version": importlib.import_module(f"nsdr.{s}").VERSION, "result": made()} for s, made in STAGES.items()
    }
    STORED.write_text(json.dumps(results, indent=1) + "\n")
