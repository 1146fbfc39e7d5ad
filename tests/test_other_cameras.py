"""Videos from other places: sizes of objects, and the camera's place from the environment."""

import os
import subprocess
import sys

import numpy as np
import pytest

from nsdr.cli.main import main
from nsdr.tracking.localization import expected_size, outline
from nsdr.tracking.size_check import size_doubt, size_ratio
from nsdr.types import SceneObject, Track, VideoTracks
from nsdr.world.camera import eye_of


def tracks(zoom: tuple[float, float], n: int = 2) -> VideoTracks:
    """Spheres at rest, whose boxes are larger than they should be by a factor of width and height."""
    found = []
    for k in range(n):
        polygon = outline("sphere", 0.5, k - 0.5)
        low, high = polygon.min(0), polygon.max(0)
        centre, half = (low + high) / 2, (high - low) / 2 * zoom
        frames = np.arange(9)
        box = np.tile(np.round([*(centre - half), *(centre + half)]), (9, 1)).astype(int)
        place = np.tile([0.5, k - 0.5], (9, 1))
        sphere = SceneObject(k, "red", "rubber", "sphere")
        found.append(Track(sphere, frames, place, np.tile(centre, (9, 1)), box, np.ones(9)))
    return VideoTracks(128, tuple(found))


def test_expected_sizes_are_those_of_outlines() -> None:
    polygon = outline("cylinder", 0.3, 0.8)
    (found,) = expected_size("cylinder", np.array([[0.3, 0.8]]))
    assert found == pytest.approx(polygon.max(0) - polygon.min(0), abs=0.5)


def test_sizes_that_do_not_fit_the_camera_are_doubtful() -> None:
    assert size_ratio(tracks((1.25, 1.0))) == pytest.approx([1.25, 1.0], abs=0.03)
    assert size_doubt(tracks((1.0, 1.0))) == ""
    assert "1.2" in size_doubt(tracks((1.25, 1.25)))
    assert "0.7" in size_doubt(tracks((0.75, 1.0)))
    assert size_ratio(tracks((2.0, 2.0), n=1)) is None


def test_the_cameras_place_is_read_from_the_environment() -> None:
    assert eye_of("") == (4.330127, 0.0, 2.5)
    assert eye_of("5, 0.5,3") == (5.0, 0.5, 3.0)
    for text in ("1,2", "1,2,x", "1,2,nan", "1,2,0.1", "0,0,3", "inf,0,2", "1,2,3,4"):
        with pytest.raises(ValueError, match=f"NSDR_CAMERA_EYE={text}: expected"):
            eye_of(text)


def test_another_place_changes_projection_and_fingerprints() -> None:
    code = (
        "from nsdr.world.camera import pixels_from_world as p; from nsdr.io.fingerprint import fingerprint as f; "
        "from nsdr.generate.render.view import RenderConfig, view_of; "
        "print(p([1.0, 1.0, 0.2]), f(code=False), view_of(RenderConfig(), 0).camera.eye_world)"
    )
    texts = []
    for eye in ("", "5.0,0.5,3.0"):
        environment = {**os.environ, "NSDR_CAMERA_EYE": eye}
        run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        texts.append(run.stdout)
    assert texts[0] != texts[1]
    assert "(5.0, 0.5, 3.0)" in texts[1]
    fingerprints = [text.split("(")[0].split()[-1] for text in texts]
    assert fingerprints[0] != fingerprints[1]


def test_a_wrong_place_is_one_line(monkeypatch, capsys) -> None:
    monkeypatch.setenv("NSDR_CAMERA_EYE", "1,2")
    monkeypatch.delitem(sys.modules, "nsdr.world.camera")
    assert main(["answer", "v.mp4", "-q", "How many spheres are moving?"]) == 2
    assert capsys.readouterr().err.startswith("error: NSDR_CAMERA_EYE=1,2: expected the camera's place as X,Y,Z")
