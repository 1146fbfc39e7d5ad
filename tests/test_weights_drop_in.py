"""Weights and parts that a user has trained, saved or downloaded, in a pipeline."""

import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from nsdr import (
    CheckpointError,
    DataError,
    FrameParser,
    GrammarParser,
    PhysicsPredictor,
    Pipeline,
    PropNetPredictor,
    QuestionParser,
    load_backend,
)
from nsdr.dynamics.physics.config import PhysicsConfig
from nsdr.dynamics.velocity_events import VelocityEvents
from nsdr.io.checkpoint import SCORES, find_checkpoint, load_description
from nsdr.pipeline import Perception
from nsdr.tracking import TrackerConfig


class Still:
    """A backend of a user's own."""

    def explain(self, states: Any, collisions: Any = None) -> Any:
        raise NotImplementedError


def test_a_saved_pipeline_is_loaded_with_its_backend(perception: Perception, tmp_path: Path) -> None:
    made = Pipeline.from_pretrained(dynamics="propnet", device="cpu")
    made.save_pretrained(tmp_path / "m")
    saved = Pipeline.from_pretrained(tmp_path / "m", device="cpu")
    assert isinstance(saved.dynamics, PropNetPredictor)
    scenes = [p.perceive(proposals=perception.proposals).scene for p in (made, saved)]
    assert scenes[0] == scenes[1]
    with pytest.warns(UserWarning, match="m has no dynamics; the shipped ones are used"):
        fitted = Pipeline.from_pretrained(tmp_path / "m", dynamics="physics")
    assert isinstance(fitted.dynamics, PhysicsPredictor)


def test_a_saved_pipeline_keeps_its_settings(tmp_path: Path) -> None:
    physics = PhysicsPredictor.from_pretrained(device="cpu", config=PhysicsConfig(runs=7))
    frame_parser = FrameParser.from_pretrained(device="cpu", stride=2)
    made = Pipeline(frame_parser, VelocityEvents(physics), GrammarParser(extensions=True), TrackerConfig(score=0.8))
    made.save_pretrained(tmp_path / "m")
    again = Pipeline.from_pretrained(tmp_path / "m", device="cpu")
    assert again.settings == made.settings
    assert (again.settings.dynamics.collisions, again.settings.dynamics.physics.runs) == ("velocity", 7)
    assert (again.frame_parser.stride, again.tracker.score, again.settings.extensions) == (2, 0.8, True)


def test_a_part_of_ones_own_is_not_left_out_silently(tmp_path: Path) -> None:
    pipeline = Pipeline.from_pretrained(device="cpu")
    pipeline.dynamics = Still()  # type: ignore[assignment]
    with pytest.raises(DataError, match="Still has no `name` of an installed backend"):
        pipeline.save_pretrained(tmp_path / "m")
    assert not (tmp_path / "m").exists()


class Frictionless(PhysicsPredictor):
    """A backend of a user's own that inherits from a shipped one."""


class Polite(GrammarParser):
    """A question parser of a user's own that inherits from a shipped one."""


def test_a_part_that_inherits_from_a_shipped_one_is_not_taken_for_it(tmp_path: Path) -> None:
    pipeline = Pipeline.from_pretrained(device="cpu")
    shipped = pipeline.dynamics
    assert isinstance(shipped, PhysicsPredictor)
    for dynamics, parser, message in (
        (Frictionless(shipped.detector), GrammarParser(), "Frictionless has no `name` of an installed backend"),
        (PhysicsPredictor(Still()), GrammarParser(), "Still is no collision detector of nsdr"),  # type: ignore[arg-type]
        (shipped, Polite(), "Polite is no question parser of nsdr"),
    ):
        pipeline.dynamics, pipeline.question_parser = dynamics, parser
        with pytest.raises(DataError, match=message):
            pipeline.save_pretrained(tmp_path / "m")


PARTS = {
    "frame_parser": (PhysicsPredictor, GrammarParser),
    "dynamics": (PropNetPredictor, GrammarParser),
    "collisions": (PhysicsPredictor, GrammarParser),
    "question_parser": (PhysicsPredictor, QuestionParser),
}
"""The dynamics and the question parser of a pipeline from a checkpoint that has one part only."""


@pytest.mark.parametrize("part", PARTS)
def test_weights_drop_in(part: str, tmp_path: Path) -> None:
    for ending in ("json", "safetensors"):
        shutil.copy(find_checkpoint() / f"{part}.{ending}", tmp_path)
    with pytest.warns(UserWarning, match="has no .*; the shipped ones are used"):
        loaded = Pipeline.from_pretrained(tmp_path, device="cpu")
    assert (type(loaded.dynamics), type(loaded.question_parser)) == PARTS[part]


def test_weights_that_were_hardly_trained_are_loaded_with_a_warning(tmp_path: Path) -> None:
    shutil.copy(find_checkpoint() / "frame_parser.safetensors", tmp_path)
    details = json.loads((find_checkpoint() / "frame_parser.json").read_text())
    details["metrics"]["f1"] = 0.018
    (tmp_path / "frame_parser.json").write_text(json.dumps(details))
    with pytest.warns(
        UserWarning, match=r"frame_parser\.json: these weights were at f1 0\.018 when their training ended"
    ):
        FrameParser.from_pretrained(tmp_path, device="cpu")


@pytest.mark.parametrize("part", SCORES)
def test_shipped_weights_have_the_score_that_is_looked_at(part: str) -> None:
    assert load_description(find_checkpoint(), part)["metrics"][SCORES[part]] > 0.9


def test_a_folder_without_parts_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"has none of frame_parser\.json.*expected the folder of a checkpoint"):
        Pipeline.from_pretrained(tmp_path)


def test_a_backend_loads_alone() -> None:
    assert isinstance(load_backend("physics"), PhysicsPredictor)
    assert isinstance(load_backend("propnet"), PropNetPredictor)


COMMIT = "0123456789abcdef0123456789abcdef01234567"


FILES = {name: find_checkpoint() / name for name in ("question_parser.json", "question_parser.safetensors")}


class Hub(BaseHTTPRequestHandler):
    """As much of the Hugging Face Hub as a download needs: one repository with the shipped networks for questions."""

    def do_GET(self) -> None:
        name = self.path.rpartition("/")[2]
        api = "/api/models/someone/parser/"
        if self.path.startswith(f"{api}revision/"):
            body = json.dumps({"id": "someone/parser", "sha": COMMIT, "siblings": []}).encode()
        elif self.path.startswith(f"{api}tree/"):
            listed = [{"type": "file", "path": file, "size": 1, "oid": "0"} for file in (*FILES, "evil.pkl")]
            body = json.dumps(listed).encode()
        elif self.path.startswith(f"/someone/parser/resolve/{COMMIT}/") and name in FILES:
            body = FILES[name].read_bytes()
        else:
            self.send_response(404)
            self.send_header("X-Error-Code", "RepoNotFound")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        self.send_response(200)
        for header, value in {"ETag": f'"{name}"', "X-Repo-Commit": COMMIT, "Content-Length": str(len(body))}.items():
            self.send_header(header, value)
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(body)

    do_HEAD = do_GET

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def hub() -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), Hub)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_a_repository_of_the_hub_is_downloaded(hub: str, tmp_path: Path, monkeypatch) -> None:
    code = (
        "import sys, nsdr; print(nsdr.QuestionParser.from_pretrained(sys.argv[1]).parse('How many cubes are there?'))"
    )
    for name, value in {"HF_ENDPOINT": hub, "HF_HOME": str(tmp_path), "HF_HUB_DISABLE_TELEMETRY": "1"}.items():
        monkeypatch.setenv(name, value)
    found = subprocess.run([sys.executable, "-c", code, "someone/parser"], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert found.stdout.strip() == "objects cube filter_shape count"
    assert not list(tmp_path.rglob("*.pkl"))
    missing = subprocess.run([sys.executable, "-c", code, "someone/else"], capture_output=True, text=True, check=False)
    assert "no checkpoint 'someone/else' (looked in " in missing.stderr
    assert "the Hugging Face Hub does not give it" in missing.stderr
