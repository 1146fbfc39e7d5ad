"""Guides whose commands need data: those of each page run in their order, on one small data set."""

import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from tests.test_docs import ROOT, commands

MADE = (
    "generate dataset --config preview -o ROOT --videos 4 --counterfactual-videos 1 --workers 1 "
    "--scene.n-frames 64 "
    '--splits \'{"train": 0.25, "validation": 0.5, "test": 0.25}\' --render.width 240 --render.height 160'
)
"""The data set of all pages: that of docs/pairs.md, with fewer, smaller and shorter videos."""
SHORTER = {
    "nsdr generate violations": "--videos 2",
    "nsdr compare-videos": "--keep-going",
    "nsdr train baseline": "--questions ROOT/questions/train.json --validation VALIDATION --plain-steps 0 --loop.steps 2",
}
"""What is added, in place of the page's own values, to commands that would take long or whose data are of another page."""
VALUES = {
    "QUESTIONS.json": "VALIDATION",
    "QUESTIONS": "VALIDATION",
    "PREDICTIONS": "keep.json",
    "FIRST": "keep.json",
    "SECOND": "keep.json",
    "TRUTH_DIR": "ROOT/truth/validation",
    "TRUTH_FOLDER": "ROOT/truth/validation",
    "DATA": "ROOT",
    "CLEVRER": "ROOT",
    "NUMBER": "5",
    "VALIDATION": "ROOT/questions/validation.json",
}
"""What stands for the placeholders of all pages, replaced in this order; folders that are written keep their names."""
PAGES = {
    "scoring.md": {"N": "2"},
    "generate.md": {},
    "questions.md": {"VIDEO": "generated_1.mp4"},
    "export.md": {},
    "pairs.md": {},
    "judge.md": {},
    "training.md": {},
    "video_models.md": {"FOLDER": "ROOT/videos/test"},
}
LEFT_OUT = (
    *("…", "|", "--help", "FORMAT"),  # no whole commands
    *("http:", "--render.assets", "paper.yaml", "--source videos", "--source proposals"),
    *("generate dataset", "--first-scene 36", "--first-scene 370000", "--first-scene 540000", "--first-scene 580000"),
    *("answers.json", "PAIRS/questions", "OTHER"),
    *(
        "--run-dir runs/mine",
        "CLEVRER/video_train",
        "data/generated",
        "--config propnet_images",
        "runs/baseline_data",
        "small/mac",
    ),
)
"""In commands that need a server, Blender, hours or many videos, that make more data, or that read what these do not make."""


def guided(page: str) -> list[str]:
    """The page's commands that run here, complete; the one that makes the answers that others read comes first."""
    found = []
    for command in commands(ROOT / "docs" / page):
        if any(part in command for part in LEFT_OUT) or len(command.split()) < 5:
            continue
        command = re.sub(r"\[--(?:device cuda|field value|workers N)\]", "", command)
        for more in (more for start, more in SHORTER.items() if command.startswith(start)):
            given = "|".join(re.findall(r"--[\w.]+ (?!--)", more)) or "$^"
            command = re.sub(rf"(?:{given})\S+ ?", "", f"{command} ") + more
        for name, value in (PAGES[page] | VALUES).items():
            command = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w.])", value, command)
        found.append(re.sub(r"[\[\]]", "", command))
    return sorted(dict.fromkeys(found), key=lambda command: "--submission" not in command)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Iterator[Path]:
    """Where the commands run: the repository's configurations, the data set, and two videos to judge."""
    place = tmp_path_factory.mktemp("guides")
    shutil.copytree(ROOT / "configs", place / "configs")
    for name in ("generated_1.mp4", "generated_2.mp4"):
        shutil.copy(VIDEO, place / name)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        assert main(shlex.split(MADE)) == 0
        yield place


@pytest.mark.docs
@pytest.mark.filterwarnings("default:.*(resized to 480x320|CLEVRER's videos have 128):UserWarning")
@pytest.mark.parametrize("page", PAGES)
def test_commands_of_guides_run(page: str, folder: Path) -> None:
    commands_of_page = guided(page)
    assert commands_of_page
    for command in commands_of_page:
        assert main(shlex.split(command)[1:]) == 0, command


@pytest.mark.robustness
@pytest.mark.filterwarnings("default")
def test_the_worked_example_of_another_camera_runs(tmp_path: Path, monkeypatch) -> None:
    """With two steps of training."""
    monkeypatch.chdir(tmp_path)
    for name in ("configs", "checkpoints"):
        (tmp_path / name).symlink_to(ROOT / name)
    page = (ROOT / "docs/own_benchmark.md").read_text(encoding="utf-8").partition("## A worked example")[2]
    for language, block in re.findall(r"^```(\w*)\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL):
        if language == "python":
            exec(compile(block, "own_benchmark.md", "exec"), {})
            continue
        for command in block.replace("\\\n", " ").splitlines():
            if command.startswith("nsdr"):
                arguments = shlex.split(command.replace("steps 500", "steps 2 --loop.warmup-steps 1"))
                assert main(arguments[1:]) == 0, command
            elif not command.startswith("pip"):
                subprocess.run(command, shell=True, check=True)
    assert json.loads(Path("scene.json").read_text())


TINY = {
    "--videos 160": "--videos 3 --workers 1",
    "--videos 100": "--videos 1 --workers 1",
    "--config world": "--config world --loop.steps 2 --loop.warmup-steps 0 --loop.batch-size 2 --evaluation-frames 2",
    "--config collisions_world": "--config collisions_world --loop.steps 2 --loop.warmup-steps 0 --loop.batch-size 2",
    "--config default": "--config default --loop.steps 2 --loop.warmup-steps 0 --evaluation-texts 2",
    "--source": "--keep-going --source",
}
"""What makes the commands of a benchmark's guide short."""


@pytest.mark.robustness
@pytest.mark.filterwarnings("default")
def test_a_benchmark_is_made_as_the_guide_says(tmp_path: Path, monkeypatch) -> None:
    """With shorter videos, few of them, and two steps of training."""
    monkeypatch.chdir(tmp_path)
    world = (ROOT / "configs/worlds/pucks.yaml").read_text().replace("frames: 100", "frames: 40")
    (tmp_path / "mine.yaml").write_text(world)
    page = (ROOT / "docs/own_benchmark.md").read_text().partition("## From the file to a leaderboard")[2]
    made = page.partition("```\n")[2].partition("```")[0].splitlines()[1:]
    assert len(made) == 9
    for command in made:
        for long, short in TINY.items():
            command = command.replace(long, short)
        assert main(shlex.split(command)[1:]) == 0, command
    assert json.loads(Path("mine/report_proposals.json").read_text())["descriptive"]
    (video,) = Path("mine/test/videos").rglob("*.mp4")
    assert main(["answer", str(video), "How many pucks are there?", "--checkpoint", "mine/weights"]) == 0
    assert main(["program", "Are there any wooden chips?", "--checkpoint", "mine/weights"]) == 0
