"""Bad input to what Python programs call: rewards, video data sets, claims, interventions, exports."""

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import nsdr
from nsdr.clevrer.example import TRUTH
from nsdr.cli.main import outcome_of
from nsdr.dynamics import StoredExplanation, simulate
from nsdr.dynamics.interventions import resolve
from nsdr.types import Add, DynamicsPrediction, Freeze, Move, Remove, Rollout, SceneObject, SetMass, SetVelocity
from nsdr.world.world import CLEVRER_WORLD
from tests.robustness.agents import call_tool
from tests.robustness.case import Case, raw, removed, replaced, text_writer
from tests.robustness.data_sets import changed, data_set
from tests.robustness.documents import CHANGES, DOCUMENTS
from tests.robustness.files import DAMAGES
from tests.robustness.good import SCENE, data_set_manifest, truth

CALL = "call"
"""First argument of cases that call a function, in place of a command."""
TEXT = "<answer>1</answer>"
RED_CUBE, OTHERS = SceneObject(0, "red", "metal", "cube"), (SceneObject(1, "blue", "rubber", "sphere"),)
VISIBLE = np.array([[True] * 8, [False] * 4 + [True] * 4])


def _scene() -> nsdr.Scene:
    return nsdr.load(TRUTH)


def _exact(**changes: Any) -> Any:
    from nsdr.rewards import exact

    columns: dict[str, Any] = {"completions": [TEXT], "solution": [TEXT], "options": [[]]}
    return exact(**(columns | changes))


def _evidence(scene: Any) -> Any:
    from nsdr.rewards import evidence

    program = ["events", "objects", "filter_in", "count"]
    return evidence(["<answer>1</answer>"], ["<answer>1</answer>"], [[]], [program], [[]], [scene])


def _videos(**changes: Any) -> Any:
    from nsdr import VideoDataset

    values = {"root": "dataset", "split": "validation", "length": 4, "images": False, "image_size": (32, 48)} | changes
    return VideoDataset(**values)[0]


def _simulate_nothing() -> Any:
    objects = (RED_CUBE, *OTHERS)
    still = Rollout(np.zeros((*VISIBLE.shape, 2)), VISIBLE, ())
    return simulate(StoredExplanation(DynamicsPrediction(objects, VISIBLE.shape[1], still)), [])


def _resolve(*changes: Any, from_frame: Any = 0) -> Any:
    return resolve(changes, (RED_CUBE, *OTHERS), VISIBLE, from_frame, CLEVRER_WORLD)


def _narrated(**changes: Any) -> Any:
    scene = _scene()
    executor = nsdr.Executor(scene)
    answer = executor.answer("events objects filter_collision count")
    return nsdr.narrate(**({"answer": answer, "scene": scene} | changes))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "rewards": _exact, "evidence": _evidence, "videos": _videos,
    "verify": lambda text, **options: nsdr.verify(text, _scene(), **options),
    "narrate": _narrated, "agent": call_tool,
}  # fmt: skip
"""What is called by name, with JSON arguments."""
CHANGED: dict[str, Callable[[], Any]] = {
    "nothing": lambda: _simulate_nothing(),
    "a word": lambda: _resolve("red cube"),
    "unknown words": lambda: _resolve(Remove("green cube")),
    "no words": lambda: _resolve(Remove("")),
    "unknown id": lambda: _resolve(Remove(7)),
    "negative id": lambda: _resolve(Remove(-1)),
    "fraction as id": lambda: _resolve(Remove(0.5)),  # type: ignore[arg-type]
    "nothing as object": lambda: _resolve(Remove(None)),  # type: ignore[arg-type]
    "list as object": lambda: _resolve(Remove(["red"])),  # type: ignore[arg-type]
    "boolean as object": lambda: _resolve(Remove(True)),
    "one object twice": lambda: _resolve(Move(0, x=0, y=0), Move(0, dx=1, dy=0)),
    "removed and moved": lambda: _resolve(Remove(0), Move(0, x=0, y=0)),
    "all removed": lambda: _resolve(Remove(0), Remove(1)),
    "there already": lambda: _resolve(Add("red", "metal", "cube", 1, 1)),
    "added twice": lambda: _resolve(Add("red", "rubber", "cube", 1, 1), Add("red", "rubber", "cube", -1, 1)),
    "frame before the video": lambda: _resolve(Remove(0), from_frame=-1),
    "frame after the video": lambda: _resolve(Remove(0), from_frame=8),
    "fraction as frame": lambda: _resolve(Remove(0), from_frame=1.5),
    "frame of words": lambda: _resolve(Remove(0), from_frame="x"),
    "not there yet": lambda: _resolve(Freeze(1)),
    "mass as text": lambda: SetMass(0, "2"),  # type: ignore[arg-type]
    "mass of nothing": lambda: SetMass(0, None),  # type: ignore[arg-type]
    "speed and factor": lambda: SetVelocity(0, speed=1, factor=2),
    "infinite direction": lambda: SetVelocity(0, direction=float("inf")),
    "half a position": lambda: Move(0, x=1),
    "number as color": lambda: Add(5, "metal", "cube", 0, 0),  # type: ignore[arg-type]
}
"""Interventions that cannot be."""
CALLS: dict[str, dict[str, tuple[str, dict[str, Any], str]]] = {
    "rewards": {
        "too few solutions": ("rewards", {"solution": []}, "solution"),
        "solution of nothing": ("rewards", {"solution": [None]}, "solution"),
        "solution as number": ("rewards", {"solution": [5]}, "solution"),
        "unread solution": ("rewards", {"solution": ["zebra"]}, "zebra"),
        "letter beyond the options": ("rewards", {"solution": ["<answer>C</answer>"], "options": [["a", "b"]]}, "C"),
        "options as text": ("rewards", {"options": ["ab"]}, "options"),
        "options of nothing": ("rewards", {"options": [None]}, "options"),
        "options of numbers": ("rewards", {"options": [[1, 2]]}, "options"),
        "negative number of options": ("rewards", {"options": [-1]}, "options"),
        "number of options as boolean": ("rewards", {"options": [True]}, "options"),
        "fraction of options": ("rewards", {"options": [1.5]}, "options"),
        "too many options": ("rewards", {"options": [1000]}, "1000"),
        "completion of nothing": ("rewards", {"completions": [None]}, "completion"),
        "completion as number": ("rewards", {"completions": [5]}, "completion"),
        "messages of nothing": ("rewards", {"completions": [[None]]}, "completion"),
        "message without its text": ("rewards", {"completions": [["assistant"]]}, "completion"),
        "content as number": ("rewards", {"completions": [[{"role": "assistant", "content": 5}]]}, "content"),
        "scene of nothing": ("evidence", {"scene": None}, "scene"),
        "scene as number": ("evidence", {"scene": 5}, "scene"),
        "missing scene": ("evidence", {"scene": "nowhere.json"}, "nowhere.json"),
        "folder as scene": ("evidence", {"scene": "."}, "."),
    },
    "claims": {
        "text of nothing": ("verify", {"text": None}, "text"),
        "negative tolerance": ("verify", {"text": "x", "tolerance_frames": -1}, "tolerance"),
        "tolerance of words": ("verify", {"text": "x", "tolerance_frames": "x"}, "tolerance"),
        "fraction of tolerance": ("verify", {"text": "x", "tolerance_frames": 0.5}, "tolerance"),
        "unknown length": ("narrate", {"length": "zebra"}, "zebra"),
    },
    "videos, option": {
        f"{name} = {value!r}": ("videos", {name: value}, name)
        for name, values in {
            "length": (-1, 0.5, "x", None, 1000), "step": (0, -1, 1.5, 1000), "hop": (-1, 0.5), "max_objects": (0, -1, 1, 1.5),
            "image_size": ([], [5], [0, 5], [-1, 5], [1.5, 5], ["a", "b"], [10**6, 10**6], 5, "ab"),
        }.items()
        for value in values
    },
}  # fmt: skip
"""Wrong calls by rule: a function of `FUNCTIONS`, its arguments, and what the error must hold."""
MANIFESTS: dict[str, Callable[[Any], object]] = {
    "no configuration": removed("config"), "configuration as list": replaced("config", []),
    "no rendering": removed("config", "render"), "rendering as text": replaced("config", "render", "x"),
    "width as text": replaced("config", "render", "width", "x"), "no width": replaced("config", "render", "width", 0),
    "huge width": replaced("config", "render", "width", 10**9), "frames as text": replaced("config", "render", "frames", "x"),
    "jitter of nothing": replaced("config", "render", "camera_jitter", None),
    "NaN as jitter": replaced("config", "render", "camera_jitter", raw("NaN")),
}  # fmt: skip
TRUTH_FILES = {
    "mass as text": replaced("objects", 0, "mass", "x"),
    "negative mass": replaced("objects", 0, "mass", -1.0), "no seed": removed("seed"), "seed as text": replaced("seed", "x"),
    "negative seed": replaced("seed", -1), "no orientation": removed("frames", 2, "objects", 0, "orientation"),
    "orientation of two": replaced("frames", 2, "objects", 0, "orientation", [0.0, 0.0]),
    "location as text": replaced("frames", 2, "objects", 0, "location", "x"),
    "location of words": replaced("frames", 2, "objects", 0, "location", ["a", 0.0, 0.0]),
    "huge location": replaced("frames", 2, "objects", 0, "location", [1e300, 0.0, 0.0]),
    "no spin": removed("frames", 2, "objects", 0, "angular_velocity"),
    "too few frames": lambda d: d["frames"].__delitem__(slice(2, None)), "other scene": replaced("scene_index", SCENE + 1),
    "object missing in a frame": lambda d: d["frames"][2]["objects"].pop(),
}  # fmt: skip
"""Changes of the truth file of a video data set."""


def call(arguments: list[str]) -> int:
    """Call a function with JSON arguments, and report what it raises as the command does; returns the status."""
    import sys

    name, values = arguments
    try:
        if name == "intervention":
            CHANGED[json.loads(values)["name"]]()
        else:
            FUNCTIONS[name](**json.loads(values))
    except Exception as e:
        status, message = outcome_of(e)
        print(message, file=sys.stderr)
        return status
    return 0


def _call(name: str, values: dict[str, Any]) -> tuple[str, ...]:
    return (CALL, name, json.dumps(values))


def library_cases() -> Iterator[Case]:
    """All wrong calls."""
    for rule, calls in CALLS.items():
        for name, (function, values, named) in calls.items():
            yield Case(f"call, {rule}", name, _call(function, values), data_set(), named)
    for name in CHANGED:
        yield Case("call, interventions", name, _call("intervention", {"name": name}))
    file = "truth/validation/truth_10000.json"
    videos = _call("videos", {})
    for name, change in MANIFESTS.items():
        write = data_set("manifest.json", changed(data_set_manifest, change))
        yield Case("call, videos, manifest", name, videos, write, "manifest.json|dataset")
    for name, change in TRUTH_FILES.items():
        yield Case("call, videos, truth", name, videos, data_set(file, changed(truth, change)), "truth_10000.json")
    for name, change in CHANGES["truth"].items():
        write = text_writer("truth.json", changed(truth, change))
        yield Case("call, reward scene", name, _call("evidence", {"scene": "truth.json"}), write, "truth.json")
    for name, damage in DAMAGES.items():
        for kind in ("truth", "scenes", "annotations"):
            write = text_writer("scene.json", damage(json.dumps(DOCUMENTS[kind][1]()).encode()))
            yield Case(
                "call, reward scene", f"{kind}: {name}", _call("evidence", {"scene": "scene.json"}), write, "scene.json"
            )


def library_controls() -> Iterator[Case]:
    """Right calls: every one must be accepted."""
    for name, values in {
        "rewards": {},
        "videos": {},
        "verify": {"text": "x"},
        "narrate": {},
    }.items():
        yield Case("control", f"call {name}", _call(name, values), data_set())
    write = text_writer("truth.json", json.dumps(truth()))
    yield Case("control", "call evidence", _call("evidence", {"scene": "truth.json"}), write)
