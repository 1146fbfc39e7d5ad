"""Images, videos and reports: tests of their content; their looks are checked by eye."""

import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pytest

import nsdr.visualize
from nsdr import DataError
from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.io.video import read_video
from nsdr.pipeline import Pipeline
from nsdr.visualize import annotated_image, stroboscopic_image, write_annotated_image, write_report


@pytest.fixture(scope="module")
def perceived():
    pipeline = Pipeline.from_pretrained()
    return read_video(VIDEO), pipeline.perceive(VIDEO)


def test_names_are_loaded_when_first_used() -> None:
    code = "import nsdr.visualize, sys; sys.exit(any(m in sys.modules for m in ('torch', 'cv2', 'matplotlib')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    assert dir(nsdr.visualize) == sorted(nsdr.visualize.__all__)
    for name in nsdr.visualize.__all__:
        assert getattr(nsdr.visualize, name).__doc__, name
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        nsdr.visualize.nothing  # noqa: B018


def test_stroboscopic_image_shows_earlier_positions(perceived) -> None:
    frames, p = perceived
    image = stroboscopic_image(frames, p.proposals, p.tracks, every=16, scale=1)
    assert image.shape == (320, 480, 3)
    changed = np.abs(image.astype(int) - frames[-1].astype(int)).max(-1) > 12
    mover = max(p.tracks.tracks, key=lambda t: float(np.ptp(t.centroid_px, axis=0).max()))
    x, y = mover.centroid_px[np.flatnonzero(mover.frame_index % 16 == 127 % 16)[1]].astype(int)
    assert changed[y - 4 : y + 4, x - 4 : x + 4].any()


def test_annotated_image_without_proposals_has_no_outlines(perceived) -> None:
    frames, p = perceived
    full, bare = (annotated_image(frames[60], 60, proposals, p.tracks, p.scene) for proposals in (p.proposals, None))
    assert full.shape == bare.shape == (640, 960, 3)
    assert (full != bare).any()


def test_annotated_image_is_written_to_a_new_folder(perceived, tmp_path) -> None:
    _, p = perceived
    write_annotated_image(tmp_path / "new" / "last.png", VIDEO, p)
    assert cv2.imread(str(tmp_path / "new" / "last.png")).shape == (640, 960, 3)
    with pytest.raises(DataError, match=r"last\.txt: cannot write an image; expected a name ending in \.png or \.jpg"):
        write_annotated_image(tmp_path / "last.txt", VIDEO, p)
    with pytest.raises(DataError, match="no tracks to draw"):
        write_annotated_image(tmp_path / "last.png", VIDEO, replace(p, tracks=None))


def test_report_needs_every_stage(perceived, tmp_path) -> None:
    frames, p = perceived
    with pytest.raises(DataError, match="a report needs a perception with proposals, tracks and dynamics"):
        write_report(tmp_path / "report.html", frames, replace(p, dynamics=None), [])


@pytest.mark.parametrize("image", ["strobe", "last", "plan", "causal"])
def test_images(image, tmp_path, capsys) -> None:
    file = tmp_path / "new" / f"{image}.png"
    assert main(["visualize", str(VIDEO), "--image", image, "-o", str(file)]) == 0
    assert cv2.imread(str(file)).std() > 5


def test_video_has_every_frame(tmp_path, capsys) -> None:
    file = tmp_path / "annotated.mp4"
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
    assert "ending in .png or .mp4 or .html" in capsys.readouterr().err
    assert main(["visualize", str(VIDEO), "--image", "plan", "--removed", "9", "-o", str(tmp_path / "a.png")]) == 2
    assert "--removed 9: the objects are 0 to" in capsys.readouterr().err
