"""The commands that make the shipped weights."""

import json
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import torch

from nsdr import DataError
from nsdr.cli.main import main
from nsdr.io.checkpoint import load_checkpoint
from nsdr.training import dynamics


def test_the_mean_of_the_initial_and_the_trained_weights(tiny_motion, tmp_path) -> None:
    small = ["--network", "propnet_patches", "--patches.hidden", "8", "--loop.batch-size", "2", "--loop.steps", "2"]
    small += ["--proposals", str(tiny_motion[0]), "--truth", str(tiny_motion[1]), "--loop.warmup-steps", "0"]

    def trained(name: str, *options: str) -> dict[str, torch.Tensor]:
        dynamics.main([*small, "--run-dir", str(tmp_path / name), *options])
        return load_checkpoint(tmp_path / name / "checkpoint", "dynamics")[0]

    first = trained("first")
    start = ["--initial", str(tmp_path / "first" / "checkpoint")]
    second, mean = trained("second", *start), trained("mean", *start, "--mean-with-initial", "true")
    assert any(not torch.equal(first[name], second[name]) for name in first)
    for name, value in mean.items():
        torch.testing.assert_close(value, (first[name] + second[name]) / 2, rtol=1e-3, atol=1e-4)
    with pytest.raises(DataError, match="--mean-with-initial: needs a checkpoint to start from"):
        trained("none", "--mean-with-initial", "true")


SMALLER = {
    "frame-parser": "--model.widths [16,16,16,16] --model.blocks 1 --model.fpn-channels 16 --model.mask-channels 16",
    "dynamics": "--model.hidden 8 --patches.hidden 8 --loop.batch-size 2",
    "collisions": "--model.width 8 --loop.batch-size 2",
    "baseline": "--loop.batch-size 4",
    "question-parser": "--model.hidden 16 --loop.batch-size 2 --evaluation-texts 2",
}
"""Options that make two steps of a recipe quick."""


@pytest.mark.robustness  # a minute
def test_the_recipes_make_every_shipped_weight(tiny_frames, tiny_motion, tmp_path, monkeypatch) -> None:
    """The commands of `make weights`, two steps each, on tiny data and with small networks."""
    root = Path(__file__).parent.parent
    monkeypatch.chdir(root)
    data, weights = tmp_path / "data", tmp_path / "weights"
    (data / "motion").mkdir(parents=True)
    shutil.copytree(tiny_frames, data / "frames")
    annotations = data / "frames" / "annotations_0.jsonl"
    annotations.write_text(annotations.read_text() * 2)  # a batch of the recipe has 8 frames
    for path, name in zip(tiny_motion, ("proposals.npz", "truth.json.gz"), strict=True):
        shutil.copy(path, data / "motion" / name)
    make = ["make", "-s", "-n", "-f", "configs/weights.mk", f"DATA={data}", f"WEIGHTS={weights}", "STEPS=2"]
    commands = subprocess.run(make, check=True, capture_output=True, text=True).stdout.splitlines()
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "nsdr"
        assert main([*arguments, *SMALLER.get(arguments[1], "").split()]) == 0
    names = ("truth/mac", "truth/mac_objects", "truth/tbd", "truth/tvqa", "pixels/mac_objects")
    baselines = [f"baselines/{name}" for name in names]
    for shipped in ("default", "propnet_patches", "propnet_images", *baselines):
        made = {path.name for path in (weights / shipped).iterdir()}
        assert made == {path.name for path in (root / "checkpoints" / shipped).iterdir()} - {"README.md"}
    card = json.loads((weights / "default" / "frame_parser.json").read_text())
    assert (card["training"]["initial"], card["training"]["loop"]["seed"]) == ("checkpoint", 1)
    again = subprocess.run(make, check=True, capture_output=True, text=True).stdout
    assert not [line for line in again.splitlines() if not line.startswith("make")]


def test_trainings_name_only_data_that_their_comments_say_how_to_make() -> None:
    root = Path(__file__).parent.parent / "configs"
    files = [f for part in ("frame_parser", "dynamics", "baselines") for f in sorted((root / part).glob("*.yaml"))]
    for file in files:
        comment, settings = [], []
        for line in file.read_text().splitlines():
            (comment if line.startswith("#") else settings).append(line)
        named = [
            line.split(": ")[1]
            for line in settings
            if line.startswith(("frames: ", "proposals: ", "data: ", "features: "))
        ]
        for path in named:
            assert not path.startswith((".", "/")), f"{file}: {path}"
            made = path if "." not in Path(path).name else str(Path(path).parent)
            assert f"-o {made}" in "\n".join(comment), f"{file}: {path}"
