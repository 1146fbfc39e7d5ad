"""Rendering with Blender (`bpy`) from CLEVR's own asset files: its base scene, shapes and materials."""

import math
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from nsdr.errors import DataError
from nsdr.generate.quiet import quiet
from nsdr.generate.render.geometry import Solid
from nsdr.generate.render.view import RenderConfig, View
from nsdr.types import SceneObject
from nsdr.world.camera import SENSOR_MM
from nsdr.world.look import Look
from nsdr.world.shapes import shape_of
from nsdr.world.vocabulary import Material
from nsdr.world.world import World

ASSET_SHAPES = {"box": "SmoothCube_v2", "sphere": "Sphere", "cylinder": "SmoothCylinder"}
ASSET_MATERIALS = {(False, 0.59): "Rubber", (True, 0.1): "MyMetal"}
"""Names of the solids and materials in CLEVR's asset files; materials by whether they are metallic, and their roughness."""
LAMPS = Look().lamps
"""The lamps of CLEVR's base scene."""
GPU_KINDS = ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL")
"""Cycles' GPU back ends, tried in this order."""

MAX_BOUNCES = 4
"""Max number of bounces of a light path."""
BLUR_GLOSSY = 2.0
"""Cycles' filter for noise from glossy reflections."""


class Blender:
    """A Blender session that renders images one after another. A process can hold only one.

    Args:
        config: image size, samples and the assets folder.

    Raises:
        DataError: `bpy` is not installed, or the assets folder lacks a file.
    """

    def __init__(self, config: RenderConfig) -> None:
        self.config = config
        self.bpy = _bpy()
        self.assets = Path(config.assets).resolve()
        self._drawn: dict[tuple[str, str, str], Any] = {}
        _check_assets(self.assets)
        with quiet():
            self.bpy.ops.wm.open_mainfile(filepath=str(self.assets / "base_scene.blend"))
            for name in ASSET_MATERIALS.values():
                self._append(self.assets / "materials" / f"{name}.blend", "NodeTree", name)
        self._lamp_positions = [tuple(self.bpy.data.objects[lamp.name].location) for lamp in LAMPS]
        self._configure()

    def render(self, objects: Sequence[SceneObject], solids: Sequence[Solid], view: View, path: str | Path) -> None:
        """Render one frame.

        Args:
            objects: colours and materials.
            solids: shapes, positions and rotations, in the same order.
            view: camera and lamps.
            path: PNG file to write.
        """
        from mathutils import Matrix

        for drawn in self._drawn.values():
            drawn.hide_render = True
        for o, solid in zip(objects, solids, strict=True):
            drawn = self._object(o, solid, view.world)
            rotation = Matrix([[float(x) for x in row] for row in solid.rotation])
            drawn.hide_render, drawn.location = False, [float(x) for x in solid.location_world]
            drawn.rotation_quaternion = rotation.to_quaternion()
        self._set_view(view)
        self.bpy.context.scene.render.filepath = str(path)
        with quiet():
            self.bpy.ops.render.render(write_still=True)

    def _configure(self) -> None:
        scene = self.bpy.context.scene
        render, cycles = scene.render, scene.cycles
        render.engine, render.use_persistent_data = "CYCLES", True
        render.image_settings.file_format = "PNG"
        cycles.samples, cycles.max_bounces, cycles.blur_glossy = self.config.samples, MAX_BOUNCES, BLUR_GLOSSY
        cycles.use_denoising, cycles.denoising_prefilter = True, "NONE"
        cycles.denoising_quality, cycles.denoising_input_passes = "FAST", "RGB_ALBEDO"
        scene.view_settings.view_transform = "Standard"
        cycles.device = "GPU" if _use_gpu(self.bpy) else "CPU"

    def _set_view(self, view: View) -> None:
        render = self.bpy.context.scene.render
        render.resolution_x, render.resolution_y = view.camera.width, view.camera.height
        render.resolution_percentage = 100
        camera = self.bpy.data.objects["Camera"]
        for constraint in list(camera.constraints):
            camera.constraints.remove(constraint)
        x, y, z = (a - b for a, b in zip(view.camera.eye_world, view.camera.target_world, strict=True))
        pitch = math.atan2(z, math.hypot(x, y))
        camera.parent, camera.rotation_mode, camera.location = None, "XYZ", view.camera.eye_world
        camera.data.lens, camera.data.sensor_width = view.camera.lens_mm, SENSOR_MM
        camera.rotation_euler = (math.pi / 2 - pitch, 0, math.atan2(y, x) + math.pi / 2)
        for lamp, position, shift in zip(LAMPS, self._lamp_positions, view.lamp_shift_world, strict=True):
            self.bpy.data.objects[lamp.name].location = [a + b for a, b in zip(position, shift, strict=True)]

    def _object(self, o: SceneObject, solid: Solid, world: World) -> Any:
        key = (o.color, o.material, o.shape)
        if key not in self._drawn:
            shape = shape_of(solid.shape)
            name = ASSET_SHAPES[shape.solid]
            self._append(self.assets / "shapes" / f"{name}.blend", "Object", name)
            drawn = self.bpy.data.objects[name]
            drawn.name, drawn.scale = "_".join(key), tuple(edge / 2 for edge in shape.size_world)
            drawn.data.materials.clear()
            drawn.data.materials.append(self._material(o, world))
            drawn.rotation_mode = "QUATERNION"
            self._drawn[key] = drawn
        return self._drawn[key]

    def _material(self, o: SceneObject, world: World) -> Any:
        material = self.bpy.data.materials.new(o.name)
        material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        group = nodes.new("ShaderNodeGroup")
        group.node_tree = self.bpy.data.node_groups[_asset(world.vocabulary.material(o.material))]
        group.inputs["Color"].default_value = [c / 255 for c in world.vocabulary.color(o.color).srgb] + [1.0]
        output = nodes.new("ShaderNodeOutputMaterial")
        material.node_tree.links.new(group.outputs["Shader"], output.inputs["Surface"])
        return material

    def _append(self, blend: Path, folder: str, name: str) -> None:
        self.bpy.ops.wm.append(filename=name, directory=str(blend / folder) + "/")


def check_assets_fit(world: World) -> None:
    """Raise `DataError` unless CLEVR's asset files have the table, lamps and materials of a world."""
    if world.look != Look():
        raise DataError(
            f"renderer blender: world {world.name}: look: the table and lamps are those of CLEVR's base scene; expected "
            "the look of the world clevrer, or renderer preview"
        )
    for material in world.vocabulary.materials:
        if (material.metallic, material.roughness) not in ASSET_MATERIALS:
            raise DataError(
                f"renderer blender: world {world.name}: material {material.word}: CLEVR's assets have metallic materials "
                "with a roughness of 0.1 and others with 0.59; expected one of these, or renderer preview"
            )


def _asset(material: Material) -> str:
    """The name of a material in the asset files."""
    return ASSET_MATERIALS[material.metallic, material.roughness]


def _bpy() -> ModuleType:
    try:
        import bpy
    except ImportError as e:
        raise DataError(
            "rendering needs the package bpy (Blender): pip install 'nsdr[render]' in a separate environment "
            "(it needs numpy 1), or choose renderer: preview"
        ) from e
    return bpy


def _check_assets(folder: Path) -> None:
    required = [folder / "base_scene.blend"]
    required += [folder / "materials" / f"{name}.blend" for name in ASSET_MATERIALS.values()]
    required += [folder / "shapes" / f"{name}.blend" for name in ASSET_SHAPES.values()]
    for path in required:
        if not path.is_file():
            raise DataError(
                f"{path}: no such file; assets must be image_generation/data of facebookresearch/clevr-dataset-gen"
            )


def _use_gpu(bpy: ModuleType) -> bool:
    preferences = bpy.context.preferences.addons["cycles"].preferences
    for kind in GPU_KINDS:
        try:
            preferences.compute_device_type = kind
        except TypeError:
            continue
        preferences.get_devices()
        if any(device.type == kind for device in preferences.devices):
            for device in preferences.devices:
                device.use = True
            return True
    return False
