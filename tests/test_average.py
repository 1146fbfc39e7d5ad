"""The mean of the weights of several runs, and the commands that make the shipped weights."""

import json
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import torch

from nsdr import CheckpointError, DataError
from nsdr.cli.main import main
from nsdr.dynamics.propnet.patch_model import PatchModel, PatchModelConfig
from nsdr.dynamics.propnet.patch_predictor import PatchPredictor
from nsdr.io.checkpoint import load_checkpoint, save_checkpoint
from nsdr.training.average import average_checkpoints

SMALL = PatchModelConfig(hidden=8, channels=(2, 2, 2))


def run_of(folder: Path, seed: int, config: PatchModelConfig = SMALL, network: str = "paper") -> Path:
    torch.manual_seed(seed)
    details = {"network": network, "metrics": {"collision_f1": 0.5}, "training": {"loop": {"seed": seed}}}
    save_checkpoint(folder, "dynamics", PatchModel(config).state_dict(), config, details)
    return folder


def test_the_mean_of_two_runs(tmp_path, capsys) -> None:
    folders = [run_of(tmp_path / name, seed) for seed, name in enumerate(("first", "second"))]
    output = tmp_path / "mean"
    assert main(["train", "average", *map(str, folders), "--part", "dynamics", "--output", str(output)]) == 0
    assert capsys.readouterr().out.strip() == str(output)
    first, second, mean = (load_checkpoint(folder, "dynamics")[0] for folder in (*folders, output))
    for name in mean:
        torch.testing.assert_close(mean[name], (first[name] + second[name]) / 2, rtol=1e-3, atol=1e-4)
    PatchPredictor.from_checkpoint(output)
    card = json.loads((output / "dynamics.json").read_text())
    assert "metrics" not in card
    assert card["network"] == "paper"
    assert [run["training"]["loop"]["seed"] for run in card["averaged"]] == [0, 1]
    assert len({run["weights_sha256"] for run in card["averaged"]}) == 2


def test_counts_of_batches_are_rounded(tmp_path) -> None:
    for name, count in (("first", 2), ("second", 4)):
        state = {"n": torch.tensor(count), "w": torch.tensor([float(count)])}
        save_checkpoint(tmp_path / name, "frame_parser", state, SMALL, {})
    average_checkpoints([tmp_path / "first", tmp_path / "second"], "frame_parser", tmp_path / "mean")
    mean, _ = load_checkpoint(tmp_path / "mean", "frame_parser")
    assert mean["n"].item() == 3
    assert mean["n"].dtype == torch.int64


def test_what_cannot_be_averaged_is_refused(tmp_path) -> None:
    first = run_of(tmp_path / "first", 0)
    wider = run_of(tmp_path / "wider", 1, PatchModelConfig(hidden=16, channels=(2, 2, 2)))
    other = run_of(tmp_path / "other", 1, network="state")
    mean = tmp_path / "mean"
    with pytest.raises(
        DataError, match=r"wider: dynamics\.json: config\.hidden: expected 8, got 16; only checkpoints of"
    ):
        average_checkpoints([first, wider], "dynamics", mean)
    with pytest.raises(DataError, match=r"other: dynamics\.json: network: expected 'paper', got 'state'"):
        average_checkpoints([first, other], "dynamics", mean)
    with pytest.raises(DataError, match="expected two or more folders of checkpoints to average, got 1"):
        average_checkpoints([first], "dynamics", mean)
    with pytest.raises(DataError, match=r"--part: expected one of frame_parser, dynamics, .* got 'dynamic'"):
        average_checkpoints([first, first], "dynamic", mean)
    with pytest.raises(CheckpointError, match=r"none.dynamics\.json: no such file"):
        average_checkpoints([first, tmp_path / "none"], "dynamics", mean)
    state, _ = load_checkpoint(first, "dynamics")
    state.pop(next(iter(state)))
    save_checkpoint(tmp_path / "less", "dynamics", state, SMALL, {"network": "paper"})
    with pytest.raises(DataError, match=r"less: dynamics\.safetensors: has other tensors than .*first"):
        average_checkpoints([first, tmp_path / "less"], "dynamics", mean)
    assert not mean.exists()


SMALLER = {
    "frame-parser": "--model.widths [16,16,16,16] --model.blocks 1 --model.fpn_channels 16 --model.mask_channels 16",
    "dynamics": "--model.hidden 8 --patches.hidden 8 --loop.batch_size 2",
    "collisions": "--model.width 8 --loop.batch_size 2",
    "baseline": "--loop.batch_size 4",
    "question-parser": "--model.hidden 16 --loop.batch_size 2 --evaluation_texts 2",
}
"""Options that make two steps of a recipe quick."""


@pytest.mark.robustness  # a minute
def test_the_recipes_make_every_shipped_weight(tiny_frames, tiny_motion, tmp_path, monkeypatch) -> None:
    """The commands of `make weights`, two steps each, on tiny data and with small networks."""
    root = Path(__file__).parent.parent
    monkeypatch.chdir(root)
    data, weights = tmp_path / "data", tmp_path / "weights"
    (data / "real").mkdir(parents=True)
    shutil.copytree(tiny_frames, data / "frames")
    annotations = data / "frames" / "annotations_0.jsonl"
    annotations.write_text(annotations.read_text() * 2)  # a batch of the recipe has 8 frames
    for path, name in zip(tiny_motion, ("proposals_train.npz", "truth_train.json.gz"), strict=True):
        shutil.copy(path, data / "real" / name)
    make = ["make", "-s", "-n", "-f", "configs/weights.mk", f"DATA={data}", f"WEIGHTS={weights}", "STEPS=2"]
    commands = subprocess.run(make, check=True, capture_output=True, text=True).stdout.splitlines()
    for command in commands:
        program, *arguments = shlex.split(command)
        assert program == "nsdr"
        assert main([*arguments, *SMALLER.get(arguments[1], "").split()]) == 0
    names = ("truth/mac", "truth/mac_objects", "truth/tbd", "truth/tvqa", "pixels/mac_objects")
    baselines = [f"baselines/{name}" for name in names]
    for shipped in ("default", "dynamics_paper", "dynamics_paper_images", *baselines):
        made = {path.name for path in (weights / shipped).iterdir()}
        assert made == {path.name for path in (root / "checkpoints" / shipped).iterdir()} - {"README.md"}
    card = json.loads((weights / "default" / "frame_parser.json").read_text())
    assert (card["training"]["initial"], card["training"]["loop"]["seed"]) == ("checkpoint", 1)
    again = subprocess.run(make, check=True, capture_output=True, text=True).stdout
    assert not [line for line in again.splitlines() if not line.startswith("make")]
