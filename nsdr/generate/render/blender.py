"""Rendering in CLEVR's style with Blender (`bpy`), from CLEVR's own asset files or from simple substitutes built here.

The substitutes follow CLEVR's base scene and materials: bevelled cube, sphere and cylinder; rubber mixes a diffuse and a
velvet-like surface under a faint gloss; metal mixes a rough and a sharp gloss; the lights are three area lamps and a sun.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from nsdr.errors import DataError
from nsdr.generate.quiet import quiet
from nsdr.generate.render.geometry import Solid
from nsdr.generate.render.materials import metal_surface, rubber_surface
from nsdr.generate.render.view import (
    GROUND_REFLECTANCE,
    LAMPS,
    SUN_ANGLE,
    SUN_DIRECTION,
    SUN_STRENGTH,
    RenderConfig,
    View,
)
from nsdr.io.files import atomic_path
from nsdr.types import SceneObject
from nsdr.world.camera import SENSOR_MM
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.vocabulary import COLORS_RGB

__all__ = ["Blender"]

ASSET_SHAPES = {"cube": "SmoothCube_v2", "sphere": "Sphere", "cylinder": "SmoothCylinder"}
ASSET_MATERIALS = {"rubber": "Rubber", "metal": "MyMetal"}
"""Names of the shapes and materials in CLEVR's asset files."""
GPU_KINDS = ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL")
"""Cycles' GPU back ends, tried in this order."""

MAX_BOUNCES = 4
"""Max number of bounces of a light path."""
BLUR_GLOSSY = 2.0
"""Cycles' filter for noise from glossy reflections."""

SPHERE_SEGMENTS, SPHERE_RINGS, CYLINDER_VERTICES = 64, 32, 96
"""Resolution of the substitutes' meshes."""
BEVEL_RADII, BEVEL_SEGMENTS = 0.07, 4
"""Width (object radii) and resolution of the substitutes' bevelled edges."""
PLANE_SIZE_WORLD = 60
"""Side of the substitutes' ground and wall."""
WALL_X_WORLD = -9.5
"""Position of the wall behind the scene."""


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
        self.assets = Path(config.assets).resolve() if config.assets else None
        self._drawn: dict[tuple[str, str, str], Any] = {}
        if self.assets is not None:
            _check_assets(self.assets)
        with quiet():
            self._open_base_scene()
        self._lamp_positions = [tuple(self.bpy.data.objects[lamp.name].location) for lamp in LAMPS]
        self._configure()

    def render(self, objects: Sequence[SceneObject], solids: Sequence[Solid], view: View, path: str | Path) -> None:
        """Render one frame and write it atomically.

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
            drawn = self._object(o)
            rotation = Matrix([[float(x) for x in row] for row in solid.rotation])
            drawn.hide_render, drawn.location = False, [float(x) for x in solid.location_world]
            drawn.rotation_quaternion = rotation.to_quaternion()
        self._set_view(view)
        with atomic_path(path) as temporary:
            self.bpy.context.scene.render.filepath = str(temporary)
            with quiet():
                self.bpy.ops.render.render(write_still=True)

    def _open_base_scene(self) -> None:
        if self.assets is None:
            self.bpy.ops.wm.read_factory_settings(use_empty=True)
            self._build_substitute_scene()
            return
        self.bpy.ops.wm.open_mainfile(filepath=str(self.assets / "base_scene.blend"))
        for name in ASSET_MATERIALS.values():
            self._append(self.assets / "materials" / f"{name}.blend", "NodeTree", name)

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

    def _object(self, o: SceneObject) -> Any:
        key = (o.color, o.material, o.shape)
        if key not in self._drawn:
            drawn = self._substitute_shape(o.shape) if self.assets is None else self._asset_shape(o.shape)
            drawn.name = "_".join(key)
            drawn.data.materials.clear()
            drawn.data.materials.append(self._material(o))
            drawn.rotation_mode = "QUATERNION"
            self._drawn[key] = drawn
        return self._drawn[key]

    def _material(self, o: SceneObject) -> Any:
        material, nodes, output = self._new_material(o.name)
        color = [c / 255 for c in COLORS_RGB[o.color]] + [1.0]
        if self.assets is None:
            surface = (rubber_surface if o.material == "rubber" else metal_surface)(
                nodes, material.node_tree.links, color
            )
        else:
            group = nodes.new("ShaderNodeGroup")
            group.node_tree = self.bpy.data.node_groups[ASSET_MATERIALS[o.material]]
            group.inputs["Color"].default_value = color
            surface = group.outputs["Shader"]
        material.node_tree.links.new(surface, output.inputs["Surface"])
        return material

    def _new_material(self, name: str) -> tuple[Any, Any, Any]:
        material = self.bpy.data.materials.new(name)
        material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        return material, nodes, nodes.new("ShaderNodeOutputMaterial")

    def _append(self, blend: Path, folder: str, name: str) -> None:
        self.bpy.ops.wm.append(filename=name, directory=str(blend / folder) + "/")

    def _asset_shape(self, shape: str) -> Any:
        assert self.assets is not None
        name = ASSET_SHAPES[shape]
        self._append(self.assets / "shapes" / f"{name}.blend", "Object", name)
        drawn = self.bpy.data.objects[name]
        drawn.scale = (OBJECT_RADIUS_WORLD,) * 3
        return drawn

    def _substitute_shape(self, shape: str) -> Any:
        add, r = self.bpy.ops.mesh, OBJECT_RADIUS_WORLD
        if shape == "sphere":
            add.primitive_uv_sphere_add(radius=r, segments=SPHERE_SEGMENTS, ring_count=SPHERE_RINGS)
        elif shape == "cube":
            add.primitive_cube_add(size=2 * r)
        else:
            add.primitive_cylinder_add(radius=r, depth=2 * r, vertices=CYLINDER_VERTICES)
        drawn = self.bpy.context.active_object
        if shape != "sphere":
            bevel = drawn.modifiers.new("bevel", "BEVEL")
            bevel.width, bevel.segments, bevel.limit_method = BEVEL_RADII * r, BEVEL_SEGMENTS, "ANGLE"
        self.bpy.ops.object.shade_auto_smooth() if shape == "cylinder" else self.bpy.ops.object.shade_smooth()
        return drawn

    def _build_substitute_scene(self) -> None:
        data, scene = self.bpy.data, self.bpy.context.scene
        scene.camera = self._linked("Camera", data.cameras.new("Camera"))
        for lamp in LAMPS:
            light = data.lights.new(lamp.name, "AREA")
            light.energy, light.size, light.color = lamp.power, lamp.side_world, lamp.color
            self._linked(lamp.name, light).location = lamp.location_world
        sun = data.lights.new("Sun", "SUN")
        sun.energy, sun.angle = SUN_STRENGTH, SUN_ANGLE
        x, y, z = SUN_DIRECTION
        self._linked("Sun", sun).rotation_euler = (0, math.acos(z), math.atan2(y, x))
        self.bpy.ops.mesh.primitive_plane_add(size=PLANE_SIZE_WORLD)
        ground = self.bpy.context.active_object
        material, nodes, output = self._new_material("Ground")
        diffuse = nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = (*(GROUND_REFLECTANCE,) * 3, 1.0)
        material.node_tree.links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
        ground.data.materials.append(material)
        # A distant wall reflects light, as the curved backdrop of CLEVR's scene does.
        self.bpy.ops.mesh.primitive_plane_add(
            size=PLANE_SIZE_WORLD, location=(WALL_X_WORLD, 0, 0), rotation=(0, math.pi / 2, 0)
        )
        self.bpy.context.active_object.data.materials.append(material)
        scene.world = data.worlds.new("World")

    def _linked(self, name: str, content: Any) -> Any:
        linked = self.bpy.data.objects.new(name, content)
        self.bpy.context.scene.collection.objects.link(linked)
        return linked


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
