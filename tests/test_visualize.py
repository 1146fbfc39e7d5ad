"""Images, videos and reports; looked at by hand, here only for what they must hold."""

import cv2
import numpy as np
import pytest

from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.io.video import read_video
from nsdr.pipeline import Pipeline
from nsdr.visualize import stroboscopic_image


@pytest.fixture(scope="module")
def seen():
    pipeline = Pipeline.from_pretrained()
    return read_video(VIDEO), pipeline.perceive(VIDEO)


def test_stroboscopic_image_shows_where_objects_were(seen) -> None:
    frames, p = seen
    image = stroboscopic_image(frames, p.proposals, p.tracks, every=16, scale=1)
    assert image.shape == (320, 480, 3)
    changed = np.abs(image.astype(int) - frames[-1].astype(int)).max(-1) > 12
    mover = max(p.tracks.tracks, key=lambda t: float(np.ptp(t.centroid_px, axis=0).max()))
    x, y = mover.centroid_px[np.flatnonzero(mover.frame_index % 16 == 127 % 16)[1]].astype(int)
    assert changed[y - 4 : y + 4, x - 4 : x + 4].any()


@pytest.mark.parametrize("image", ["strobe", "last", "plan", "causal"])
def test_images(image, tmp_path, capsys) -> None:
    file = tmp_path / "new" / f"{image}.png"
    assert main(["visualize", str(VIDEO), "--image", image, "-o", str(file)]) == 0
    assert cv2.imread(str(file)).std() > 5


def test_video_has_all_frames(tmp_path, capsys) -> None:
    file = tmp_path / "seen.mp4"
    assert main(["visualize", str(VIDEO), "-o", str(file)]) == 0
    video = cv2.VideoCapture(str(file))
    size = [video.get(k) for k in (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
    assert size == [128, 960, 640]


def test_report_holds_question_program_trace_and_images(tmp_path, capsys) -> None:
    file = tmp_path / "report.html"
    question = ["-q", "How many collisions happen?"]
    assert main(["visualize", str(VIDEO), *question, "-o", str(file)]) == 0
    page = file.read_text()
    for text in (
        "How many collisions happen?",
        "events objects filter_collision count",
        "program tree",
        "Without each object",
    ):
        assert text in page
    assert page.count("data:image/png;base64,") >= 6
    assert "http" not in page  # self-contained


def test_errors_say_what_is_wrong(tmp_path, capsys) -> None:
    assert main(["visualize", str(VIDEO), "-o", "a.gif"]) == 2
    assert "ending in .mp4, .png or .html" in capsys.readouterr().err
    assert main(["visualize", str(VIDEO), "--removed", "9", "-o", str(tmp_path / "a.png")]) == 2
    assert "--removed 9: the objects are 0 to" in capsys.readouterr().err
