"""What the manifest of a generated data set says about its physics and its videos."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from nsdr.errors import DataError
from nsdr.generate.physics.bullet import BulletConfig
from nsdr.generate.render.view import RenderConfig
from nsdr.io.configuration import config_of
from nsdr.validation import Settings, convert

Config = TypeVar("Config", bound=Settings)


class _Scene(msgspec.Struct):
    physics: dict[str, Any] = {}


class _Config(msgspec.Struct):
    render: dict[str, Any]
    scene: _Scene = msgspec.field(default_factory=_Scene)


class _Manifest(msgspec.Struct):
    config: _Config


def made_with(manifest: Mapping[str, Any], root: Path) -> tuple[BulletConfig, RenderConfig]:
    """Physics and rendering options of a generated data set whose videos show every frame.

    Args:
        manifest: content of its `manifest.json`.
        root: its folder.

    Raises:
        DataError: the manifest has no valid options, or the videos show only some of the frames.
    """
    where = f"{root / 'manifest.json'}: "
    config = convert(manifest, _Manifest, where).config
    physics = _known(BulletConfig, config.scene.physics, f"{where}config.scene.physics")
    render = _known(RenderConfig, config.render, f"{where}config.render")
    if render.frames:
        raise DataError(f"{root}: its videos show {render.frames} frames of each scene; make videos of all (frames: 0)")
    return physics, render


def _known(kind: type[Config], values: Mapping[str, Any], where: str) -> Config:
    """Settings from the values with known names: other versions of nsdr wrote other names."""
    try:
        return config_of(kind, {f.name: values[f.name] for f in fields(kind) if f.name in values})
    except DataError as e:
        raise DataError(f"{where}: {e}") from e
