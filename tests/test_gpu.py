"""`make gpu`: some of its rows, on a simulated device; what fails costs no other row."""

import os
from pathlib import Path

import numpy as np
import pytest
from pycocotools import mask as rle

from benchmarks import gpu
from benchmarks.gpu_rows import SIMULATED, Result, Setting, question_parser, resumed, same_answers, same_detections
from nsdr import Answer, VideoProposals
from nsdr.clevrer.files.proposals import proposals_from_rows


def dies(setting: Setting) -> Result:
    os._exit(3)


def fails(setting: Setting) -> Result:
    raise RuntimeError("CUDA error:\nan illegal | memory access")


def differs(setting: Setting) -> Result:
    return "1 of 2 answers differ", False


@pytest.mark.robustness
def test_rows_go_on_after_a_failure_and_the_death_of_their_process(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(
        gpu,
        "rows",
        lambda small: {"results: a": dies, "b": fails, "results: c": differs, "d": question_parser},
    )
    table = tmp_path / "gpu.md"
    options = ["--device", SIMULATED, "--small", "--work", str(tmp_path), "--at-once", "2", "--revision", "abc"]
    assert gpu.main(["-o", str(table), *options]) == 1
    assert "`make gpu` with `--small` at revision abc, " in table.read_text()
    head, a, b, c, d = table.read_text().splitlines()[-5:]
    assert set(head) == set("|-")
    assert a.startswith("| results: a | BrokenProcessPool: ")
    assert a.endswith(" | **failed** | - | - |")
    assert b == "| b | RuntimeError: CUDA error: an illegal / memory access | **failed** | - | - |"
    assert c == "| results: c | 1 of 2 answers differ | **no** | 0 | - |"
    assert d.startswith("| d | 0 of 60 programs differ; probabilities within ")
    assert " | yes | " in d


def test_the_exit_status_is_0_where_all_is_as_expected(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(gpu, "rows", lambda small: {"a": lambda setting: ("1", True)})
    monkeypatch.setattr(gpu, "all_measured", lambda chosen, setting, at_once: iter([("a", ("1", "yes", "0", "-"))]))
    assert gpu.main(["-o", str(tmp_path / "gpu.md"), "--device", SIMULATED, "--work", str(tmp_path)]) == 0
    assert (tmp_path / "gpu.md").read_text().endswith("|---|---|---|---|---|\n| a | 1 | yes | 0 | - |\n")


def test_unknown_devices_and_rows_are_refused(tmp_path: Path, capsys) -> None:
    for options, message in (
        (["--device", "cuda:77"], "device 'cuda:77' cannot be used"),
        (["--only", "x!"], "no row has x!"),
    ):
        with pytest.raises(SystemExit, match="2"):
            gpu.main(["-o", str(tmp_path / "gpu.md"), "--work", str(tmp_path), *options])
        assert message in capsys.readouterr().err


@pytest.mark.robustness
def test_a_resumed_run_is_compared_with_the_whole_one(tmp_path: Path) -> None:
    text, is_well = resumed(Setting(SIMULATED, tmp_path, small=True), "question-parser")
    assert (text, is_well) == ("losses of 4 steps within 0", True)


def test_other_detections_are_told_from_the_same() -> None:
    def detections(*rows: tuple[int, int]) -> VideoProposals:
        """Of attributes, in squares of 40 px from a column on."""
        image = np.zeros((len(rows), 320, 480), np.uint8)
        for mask, (_, left) in zip(image, rows, strict=True):
            mask[100:140, left : left + 40] = 1
        masks = [rle.encode(np.asfortranarray(mask))["counts"].decode() for mask in image]
        return proposals_from_rows(1, [(0, row[0], 0.9, mask) for row, mask in zip(rows, masks, strict=True)])

    one = detections((3, 50), (7, 200))
    text = "the same 2 detections; mask IoU from {}, scores within 0"
    assert same_detections(detections((7, 200), (3, 50)), one) == (text.format("1.000"), True)
    assert same_detections(detections((3, 60), (7, 200)), one) == (text.format("0.600"), False)
    assert not same_detections(detections((4, 50), (7, 200)), one)[1]
    assert not same_detections(detections((3, 50)), one)[1]


def test_other_answers_are_told_from_the_same() -> None:
    yes, no = (Answer("Is there a cube?", (), word, probability=0.75) for word in ("yes", "no"))
    assert same_answers([yes, no], [yes, no]) == ("0 of 2 answers differ; probabilities within 0", True)
    assert same_answers([yes, yes], [yes, no]) == ("1 of 2 answers differ; probabilities within 0", False)
