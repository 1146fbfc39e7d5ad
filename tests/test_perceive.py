"""Whole folders of videos."""

import json

import pytest

from nsdr import DataError, Scene, load
from nsdr.cli import main
from nsdr.examples import VIDEO
from nsdr.generate.encode import write_video
from nsdr.perceive import parse_videos


@pytest.fixture
def videos(tmp_path):
    from nsdr.frame_parser.video import read_video

    folder = tmp_path / "videos"
    frames = read_video(VIDEO)[40:60]
    for number in (1, 2):
        write_video(folder / f"video_0000{number}.mp4", frames)
    (folder / "video_00003.mp4").write_bytes(b"no video")
    return folder


@pytest.mark.filterwarnings("ignore:.*20 frames")
def test_a_folder_is_parsed_skipping_what_is_done_and_what_fails(videos, tmp_path, capsys) -> None:
    output = tmp_path / "scenes"
    assert main(["parse-videos", str(videos), "-o", str(output), "--workers", "1", "--stride", "2"]) == 1
    text = capsys.readouterr().out
    assert "2 done, 0 done before, 1 failed" in text
    assert "video_00003.mp4: VideoError" in text
    assert len(load(Scene, output / "scene_00001.json").objects) >= 2
    assert json.loads((output / "proposal_00001.json").read_text())["video_index"] == 1
    assert list(json.loads((output / "failures.json").read_text())) == ["video_00003.mp4"]
    before = (output / "scene_00002.json").read_bytes()
    (output / "scene_00001.json").unlink()
    (videos / "video_00003.mp4").unlink()
    summary = parse_videos(videos, output, stride=2, workers=1)
    assert summary.done == ("video_00001.mp4",)
    assert summary.skipped == ("video_00002.mp4",)
    assert summary.failed == {}
    assert (output / "scene_00002.json").read_bytes() == before


def test_a_folder_without_videos_is_an_error(tmp_path) -> None:
    with pytest.raises(DataError, match=r"holds no \*\.mp4"):
        parse_videos(tmp_path, tmp_path / "out")
