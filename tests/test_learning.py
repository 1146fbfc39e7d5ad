from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks import learning
from benchmarks.learning import Rows, Run, Tower

N_VIDEOS = 12


@pytest.fixture
def rows() -> Rows:
    """Questions about videos of one colour, which is the answer."""
    colors = torch.tensor([[200, 40, 40], [40, 40, 200]], dtype=torch.uint8)
    shown = [i % 2 for i in range(N_VIDEOS)]
    frames = colors[shown][:, None, :, None, None].expand(-1, 8, -1, 32, 48).contiguous()
    solutions = [f"<answer>{('red', 'blue')[i]}</answer>" for i in shown for _ in range(2)]
    texts = ["What color is the cube?", "What is the color of the cube?"] * N_VIDEOS
    return Rows(texts, solutions, [np.array([2 * v, 2 * v + 1]) for v in range(N_VIDEOS)], frames, [])


def test_rewards_teach_what_the_video_shows(rows: Rows, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "EVALUATE_EVERY", 10)
    torch.manual_seed(0)
    tower = Tower().eval()
    run = Run(tower, rows, rows, False, tmp_path / "seeing.pt")
    run.learn(2, 28)
    earned = {shown: np.mean(rewards) for shown, rewards in run.curve[-1]["earned"].items()}
    assert earned["its own video"] == 1
    assert earned["gray frames"] == 0.5
    assert [point["phase"] for point in run.curve] == ["random weights", "supervised", *["rewards"] * 3]

    killed = Run(tower, rows, rows, False, tmp_path / "killed.pt")
    killed.learn(2, 8)
    resumed = Run(tower, rows, rows, False, tmp_path / "killed.pt")
    resumed.learn(2, 28)
    for name, weights in run.model.state_dict().items():
        assert torch.equal(weights, resumed.model.state_dict()[name]), name

    with pytest.raises(ValueError, match=r"seeing\.pt is of a run on other rows; give another --run-dir"):
        Run(tower, rows, replace(rows, solutions=rows.solutions[::-1]), False, tmp_path / "seeing.pt")

    blind = Run(tower, rows, rows, True, tmp_path / "blind.pt")
    blind.learn(2, 28)
    assert np.mean(blind.curve[-1]["earned"]["its own video"]) == 0.5
