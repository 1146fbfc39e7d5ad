"""Wrong configurations: every number of every configuration, damaged YAML files, and experiments."""

import os
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import yaml

from nsdr.generate.dataset import DatasetConfig
from nsdr.pipeline import PipelineConfig
from nsdr.training.frame_parser import FrameParserTraining
from nsdr.training.question_parser import QuestionParserTraining
from nsdr.training.track_task import DynamicsTraining
from tests.robustness.case import Case, Write, text_writer
from tests.robustness.files import gzip_bomb
from tests.robustness.good import PREDICT, ROW

TRAINED = {"run_dir": "run", "loop": {"steps": 1, "device": "cpu"}}
CONFIGURATIONS: dict[str, tuple[Any, tuple[str, ...], dict[str, Any]]] = {
    "pipeline": (PipelineConfig, (*PREDICT, "--config", "config.yaml"), {}),
    "question parser": (QuestionParserTraining, ("train", "question-parser", "--config", "config.yaml"),
                        {**TRAINED, "questions": "nowhere.json"}),
    "frame parser": (FrameParserTraining, ("train", "frame-parser", "--config", "config.yaml"),
                     {**TRAINED, "frames": "nowhere"}),
    "dynamics": (DynamicsTraining, ("train", "dynamics", "--config", "config.yaml"),
                 {**TRAINED, "proposals": "nowhere.npz", "truth": "nowhere.json.gz"}),
    "data set": (DatasetConfig, ("generate", "dataset", "--config", "config.yaml", "--workers", "1"),
                 {"output": "out", "videos": 1, "renderer": "none"}),
}  # fmt: skip
"""Configuration, command and what it needs besides."""
WRONG_SETTINGS: dict[type, tuple[Any, ...]] = {
    int: ("zebra", 1.5, -1),
    float: ("zebra", -1.0, float("nan"), float("inf")),
    bool: ("zebra", 5),
}
SIGNED = ("image_mean", "area", "bias")
"""Numbers that may be negative."""


def _settings(kind: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Path and type of every number of a configuration."""
    hints = get_type_hints(kind)
    for field in fields(kind):
        hint = hints[field.name]
        inner = next((t for t in get_args(hint) if is_dataclass(t)), hint)
        if is_dataclass(inner):
            in_list = (0,) if get_origin(hint) is tuple else ()
            yield from _settings(inner, (*path, field.name, *in_list))
        else:
            yield (*path, field.name), next((t for t in (hint, *get_args(hint)) if t in WRONG_SETTINGS), None)


def _wrong_configurations() -> Iterator[Case]:
    for name, (kind, argv, needed) in CONFIGURATIONS.items():
        for path, number in _settings(kind):
            if number is None or path[-1] in SIGNED or (path[0] == "loop" and name != "question parser"):
                continue  # all trainings have the same loop
            if path == ("workers",):
                continue  # the command gives it, too
            for value in WRONG_SETTINGS[number]:
                content = yaml.safe_load(yaml.safe_dump(needed))
                holder = content
                for key, following in pairwise(path):
                    holder = holder[0] if key == 0 else holder.setdefault(key, [{}] if following == 0 else {})
                holder[path[-1]] = value
                yield Case(f"configuration, {name}", f"{'.'.join(map(str, path))} = {value!r}", argv,
                           text_writer("config.yaml", yaml.safe_dump(content)), path[-1])  # fmt: skip
        unknown = text_writer("config.yaml", yaml.safe_dump({**needed, "zebra": 1}))
        yield Case(f"configuration, {name}", "unknown key", argv, unknown, "zebra")
        for key in [f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]:
            rest = {k: v for k, v in needed.items() if k != key}
            if argv[0] != "generate":
                yield Case(
                    f"configuration, {name}",
                    f"without {key}",
                    argv,
                    text_writer("config.yaml", yaml.safe_dump(rest)),
                    f"{key}|{key.replace('_', '-')}",
                )
        for label, damage in YAML_DAMAGES.items():
            write = text_writer("config.yaml", damage)
            yield Case(f"configuration file, {name}", label, argv, write, "config.yaml")
        yield Case(
            f"configuration file, {name}", "folder", argv, lambda f, _: (f / "config.yaml").mkdir(), "config.yaml"
        )
        yield Case(f"configuration file, {name}", "missing", argv, named="config.yaml")
        yield Case(
            f"configuration file, {name}", "pipe", argv, lambda f, _: os.mkfifo(f / "config.yaml"), "config.yaml"
        )


LAUGHS = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))
YAML_DAMAGES: dict[str, bytes] = {
    "list": b"[1, 2]",
    "text": b"zebra",
    "number": b"5",
    "bad indentation": b"a:\n  b: 1\n c: 2\n",
    "tab": b"a:\n\tb: 1\n",
    "unclosed": b"loop: {steps: 5",
    "key twice": b"run_dir: a\nrun_dir: b\nzebra: 1\n",
    "binary": bytes(range(256)) * 10,
    "UTF-16": "stride: 1\n".encode("utf-16")[2:],
    "Python object": b"stride: !!python/object/apply:os.system ['touch hacked']\n",
    "many aliases": LAUGHS.encode(),
    "10,000 brackets": b"stride: " + b"[" * 10_000,
    "2 MB": b"# " + b"x" * 2_000_000 + b"\nzebra: 1\n",
    "two documents": b"stride: 1\n---\nstride: 2\n",
    "number of 5,000 digits": b"stride: " + b"9" * 5000,
    "compressed": gzip_bomb()[:1000],
}
"""Damaged YAML files."""
EXPERIMENT_ROWS: dict[str, dict[str, Any]] = {
    "programs": {"programs": "zebra"}, "types": {"types": ["zebra"]}, "types as text": {"types": "descriptive"},
    "no types": {"types": []}, "every": {"every": -1}, "every of 0": {"every": 0}, "limit": {"limit": -1},
    "limit as text": {"limit": "x"}, "limit as fraction": {"limit": 1.5},
    "source": {"source": "zebra"}, "source as number": {"source": 5}, "unknown key": {"zebra": 1},
    "name as number": {"name": 5}, "no name": {"name": None}, "questions as number": {"questions": 5},
    "missing questions": {"questions": "nowhere.json"}, "missing data": {"data": "nowhere"},
    "baseline": {"baseline": "zebra"},
    "published as text": {"published": "x"}, "published too short": {"published": [1, 2]},
    "published of words": {"published": ["x"] * 7}, "published above 100": {"published": [200.0] * 7},
    "published NaN": {"published": [float("nan")] * 7}, "semantics": {"semantics": "zebra"},
    "collisions": {"collisions": "zebra"}, "workers": {"workers": -1}, "engine": {"engine": "zebra"},
    "checkpoint": {"checkpoint": "nowhere", "programs": "parsed"}, "split": {"split": "zebra"}, "set": {"set": "x"},
    "set of numbers": {"set": [5]},
}  # fmt: skip
"""Changes to a good row of an experiment."""


def _experiment_cases() -> Iterator[Case]:
    argv, file = ("experiment", "rows.yaml", "-o", "out"), "rows.yaml"

    def rows(content: Any) -> Write:
        return lambda folder, good: (folder / file).write_text(yaml.safe_dump(content).replace("{good}", str(good)))

    for name, change in EXPERIMENT_ROWS.items():
        yield Case("experiment, row", name, argv, rows({"title": "x", "rows": [ROW | change]}), f"{file}|nowhere")
    yield Case("experiment, row", "name twice", argv, rows({"title": "x", "rows": [ROW, ROW]}), file)
    for name, content in {
        "no title": {"rows": [ROW]}, "no rows": {"title": "x"}, "empty rows": {"title": "x", "rows": []},
        "title as number": {"title": 5, "rows": [ROW]}, "rows as text": {"title": "x", "rows": "x"},
        "row as text": {"title": "x", "rows": ["x"]}, "common as list": {"title": "x", "common": [1], "rows": [ROW]},
        "unknown key": {"title": "x", "zebra": 1, "rows": [ROW]},
    }.items():  # fmt: skip
        yield Case("experiment, file", name, argv, rows(content), file)
    for name, damage in YAML_DAMAGES.items():
        yield Case("experiment, file", name, argv, text_writer(file, damage), file)
    kept = text_writer("out/rows.json", "zebra")

    def damaged_results(folder: Path, good: Path) -> None:
        rows({"title": "x", "rows": [ROW]})(folder, good)
        kept(folder, good)

    yield Case("experiment, file", "damaged results", argv, damaged_results, "rows.json")


def configuration_cases() -> Iterator[Case]:
    """All wrong configurations."""
    yield from _wrong_configurations()
    yield from _experiment_cases()
