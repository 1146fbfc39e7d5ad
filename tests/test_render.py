"""Rendering with Blender. Needs `bpy` in a separate environment: `pip install -e '.[render]' pytest hypothesis`."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from nsdr import DataError
from nsdr.generate.render.blender import Blender
from nsdr.generate.render.geometry import Solid, instance_ids
from nsdr.generate.render.view import RenderConfig, View
from nsdr.types import SceneObject
from nsdr.world.camera import Camera

pytestmark = pytest.mark.render


def test_renders_match_the_release_and_the_masks(shared: Path, tmp_path: Path) -> None:
    blender = Blender(RenderConfig(assets=str(shared / "clevr_assets")))
    path = tmp_path / "empty.png"
    blender.render([], [], View(), path)
    real = cv2.imread(str(shared / "real" / "background.png")).astype(float)
    difference = np.abs(cv2.imread(str(path)) - real).mean()
    assert difference <= 2.5
    objects = (SceneObject(0, "yellow", "rubber", "sphere"), SceneObject(1, "red", "metal", "cube"))
    solids = [Solid("sphere", np.array([0.5, -0.8, 0.2]), np.eye(3)), Solid("cube", np.array([0, 0.8, 0.2]), np.eye(3))]
    blender.render(objects, solids, View(), tmp_path / "two.png")
    image = cv2.imread(str(tmp_path / "two.png"), cv2.IMREAD_COLOR_RGB).astype(float)
    ids = instance_ids(solids, Camera())
    yellow, red = image[ids == 0].mean(0), image[ids == 1].mean(0)
    assert min(yellow[0], yellow[1]) > 1.5 * yellow[2]
    assert red[0] > 1.5 * red[1]


def test_missing_assets_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"base_scene\.blend: no such file"):
        Blender(RenderConfig(assets=str(tmp_path)))
