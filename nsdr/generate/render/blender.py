"""CLEVR's look in Blender (`bpy`): from CLEVR's own asset files, or from plain substitutes built here.

The substitutes follow the facts of CLEVR's base scene and materials: bevelled cube, sphere and cylinder; rubber mixes a
diffuse and a velvet-like surface under a faint gloss, metal mixes a rough and a sharp gloss; three area lamps and a sun.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from nsdr.errors import DataError
from nsdr.generate.quiet import quiet
from nsdr.generate.render.lamps import GROUND_REFLECTANCE, LAMPS, SUN_DIRECTION, SUN_STRENGTH
from nsdr.generate.render.raycast import Solid
from nsdr.generate.render.view import RenderConfig, View
from nsdr.io.files import atomic_path
from nsdr.types import SceneObject
from nsdr.world.camera import LENS_MM, SENSOR_MM
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.vocabulary import COLORS_RGB

__all__ = ["Blender"]

ASSET_SHAPES = {"cube": "SmoothCube_v2", "sphere": "Sphere", "cylinder": "SmoothCylinder"}
ASSET_MATERIALS = {"rubber": "Rubber", "metal": "MyMetal"}
LAMP_OBJECTS = ("Lamp_Key", "Lamp_Fill", "Lamp_Back")


class Blender:
    """A Blender session that renders one image after another. There can be one in a process.

    Args:
        config: size, samples and the assets' folder.
        threads: CPU threads; 0 takes all.

    Raises:
        DataError: `bpy` is not installed, or the assets' folder lacks a file.
    """

    def __init__(self, config: RenderConfig, threads: int = 0) -> None:
        self.config = config
        self.bpy = _bpy()
        self.assets = Path(config.assets).resolve() if config.assets else None
        self._drawn: dict[tuple[str, str, str], Any] = {}
        if self.assets is not None:
            _check_assets(self.assets)
        with quiet():
            self._open_stage()
        self._lamp_positions = {name: tuple(self.bpy.data.objects[name].location) for name in LAMP_OBJECTS}
        self._settings(threads)

    def render(self, objects: Sequence[SceneObject], solids: Sequence[Solid], view: View, path: str | Path) -> None:
        """Write a image of objects as they stand as a PNG or JPEG file, atomically.

        Args:
            objects: colours and materials.
            solids: shapes, positions and turns, in the same order.
            view: camera and lamps.
            path: file to write.
        """
        from mathutils import Matrix

        for drawn in self._drawn.values():
            drawn.hide_render = True
        for o, solid in zip(objects, solids, strict=True):
            drawn = self._object(o)
            turn = Matrix([[float(x) for x in row] for row in solid.rotation])
            drawn.hide_render, drawn.location = False, [float(x) for x in solid.location_world]
            drawn.rotation_quaternion = turn.to_quaternion()
        self._look(view)
        with atomic_path(path) as temporary:
            scene = self.bpy.context.scene
            scene.render.image_settings.file_format = "JPEG" if temporary.suffix == ".jpg" else "PNG"
            scene.render.filepath = str(temporary)
            with quiet():
                self.bpy.ops.render.render(write_still=True)

    def _open_stage(self) -> None:
        if self.assets is None:
            self.bpy.ops.wm.read_factory_settings(use_empty=True)
            self._plain_stage()
            return
        self.bpy.ops.wm.open_mainfile(filepath=str(self.assets / "base_scene.blend"))
        for name in ASSET_MATERIALS.values():
            self._append(self.assets / "materials" / f"{name}.blend", "NodeTree", name)

    def _settings(self, threads: int) -> None:
        scene = self.bpy.context.scene
        render, cycles = scene.render, scene.cycles
        render.engine, render.use_persistent_data = "CYCLES", True
        render.image_settings.quality = 95
        cycles.samples, cycles.max_bounces, cycles.blur_glossy = self.config.samples, 4, 2.0
        cycles.use_denoising, cycles.denoising_prefilter = True, "NONE"
        cycles.denoising_quality, cycles.denoising_input_passes = "FAST", "RGB_ALBEDO"
        scene.view_settings.view_transform = "Standard"
        if threads:
            render.threads_mode, render.threads = "FIXED", threads
        cycles.device = "GPU" if _use_gpu(self.bpy) else "CPU"

    def _look(self, view: View) -> None:
        render = self.bpy.context.scene.render
        render.resolution_x, render.resolution_y, render.resolution_percentage = (
            view.camera.width,
            view.camera.height,
            100,
        )
        camera = self.bpy.data.objects["Camera"]
        for constraint in list(camera.constraints):
            camera.constraints.remove(constraint)
        x, y, z = view.camera.eye_world
        down = math.atan2(z, math.hypot(x, y))
        camera.parent, camera.rotation_mode, camera.location = None, "XYZ", (x, y, z)
        camera.rotation_euler = (math.pi / 2 - down, 0, math.atan2(y, x) + math.pi / 2)
        for name, shift in zip(LAMP_OBJECTS, view.lamp_shift_world, strict=True):
            self.bpy.data.objects[name].location = [
                a + b for a, b in zip(self._lamp_positions[name], shift, strict=True)
            ]

    def _object(self, o: SceneObject) -> Any:
        key = (o.color, o.material, o.shape)
        if key not in self._drawn:
            drawn = self._plain_shape(o.shape) if self.assets is None else self._asset_shape(o.shape)
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
            surface = (_rubber if o.material == "rubber" else _metal)(nodes, material.node_tree.links, color)
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

    def _plain_shape(self, shape: str) -> Any:
        add, r = self.bpy.ops.mesh, OBJECT_RADIUS_WORLD
        if shape == "sphere":
            add.primitive_uv_sphere_add(radius=r, segments=64, ring_count=32)
        elif shape == "cube":
            add.primitive_cube_add(size=2 * r)
        else:
            add.primitive_cylinder_add(radius=r, depth=2 * r, vertices=96)
        drawn = self.bpy.context.active_object
        if shape != "sphere":
            bevel = drawn.modifiers.new("bevel", "BEVEL")
            bevel.width, bevel.segments, bevel.limit_method = 0.07 * r, 4, "ANGLE"
        self.bpy.ops.object.shade_auto_smooth() if shape == "cylinder" else self.bpy.ops.object.shade_smooth()
        return drawn

    def _plain_stage(self) -> None:
        data, scene = self.bpy.data, self.bpy.context.scene
        camera = data.cameras.new("Camera")
        camera.lens, camera.sensor_width = LENS_MM, SENSOR_MM
        scene.camera = self._linked("Camera", camera)
        for lamp, name in zip(LAMPS, LAMP_OBJECTS, strict=True):
            light = data.lights.new(name, "AREA")
            light.energy, light.size, light.color = lamp.power, lamp.side_world, lamp.color
            self._linked(name, light).location = lamp.location_world
        sun = data.lights.new("Sun", "SUN")
        sun.energy, sun.angle = SUN_STRENGTH, 0.2
        x, y, z = SUN_DIRECTION
        turned = self._linked("Sun", sun)
        turned.rotation_euler = (0, math.acos(z), math.atan2(y, x))
        self.bpy.ops.mesh.primitive_plane_add(size=60)
        ground = self.bpy.context.active_object
        material, nodes, output = self._new_material("Ground")
        diffuse = nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = (*(GROUND_REFLECTANCE,) * 3, 1.0)
        material.node_tree.links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
        ground.data.materials.append(material)
        # A distant wall gives back light, as the curved backdrop of CLEVR's scene does.
        self.bpy.ops.mesh.primitive_plane_add(size=60, location=(-9.5, 0, 0), rotation=(0, math.pi / 2, 0))
        self.bpy.context.active_object.data.materials.append(material)
        world = data.worlds.new("World")
        scene.world = world

    def _linked(self, name: str, content: Any) -> Any:
        holder = self.bpy.data.objects.new(name, content)
        self.bpy.context.scene.collection.objects.link(holder)
        return holder


def _bpy() -> ModuleType:
    try:
        import bpy
    except ImportError as e:
        raise DataError(
            "rendering needs Blender as a package: pip install 'nsdr[render]' in an environment of its own "
            "(it wants numpy 1), or choose renderer: preview"
        ) from e
    return bpy


def _check_assets(folder: Path) -> None:
    wanted = [folder / "base_scene.blend"]
    wanted += [folder / "materials" / f"{name}.blend" for name in ASSET_MATERIALS.values()]
    wanted += [folder / "shapes" / f"{name}.blend" for name in ASSET_SHAPES.values()]
    for path in wanted:
        if not path.is_file():
            raise DataError(
                f"{path}: no such file; assets is image_generation/data of facebookresearch/clevr-dataset-gen"
            )


def _use_gpu(bpy: ModuleType) -> bool:
    preferences = bpy.context.preferences.addons["cycles"].preferences
    for kind in ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL"):
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


def _mix(nodes: Any, links: Any, factor: Any, first: Any, second: Any) -> Any:
    mix = nodes.new("ShaderNodeMixShader")
    if isinstance(factor, float):
        mix.inputs[0].default_value = factor
    else:
        links.new(factor, mix.inputs[0])
    links.new(first, mix.inputs[1])
    links.new(second, mix.inputs[2])
    return mix.outputs[0]


def _surface(nodes: Any, kind: str, color: Sequence[float], roughness: float | None = None) -> Any:
    node = nodes.new(kind)
    node.inputs["Color"].default_value = color
    if roughness is not None:
        node.inputs["Roughness"].default_value = roughness
    return node.outputs[0]


def _fresnel(nodes: Any, ior: float) -> Any:
    node = nodes.new("ShaderNodeFresnel")
    node.inputs["IOR"].default_value = ior
    return node.outputs[0]


def _rubber(nodes: Any, links: Any, color: Sequence[float]) -> Any:
    diffuse = _surface(nodes, "ShaderNodeBsdfDiffuse", color)
    velvet = _surface(nodes, "ShaderNodeBsdfSheen", color, 0.6)
    gloss = _surface(nodes, "ShaderNodeBsdfGlossy", (0.8, 0.8, 0.8, 1.0), 0.59)
    soft = _mix(nodes, links, _fresnel(nodes, 1.2), diffuse, velvet)
    return _mix(nodes, links, _fresnel(nodes, 1.25), soft, gloss)


def _metal(nodes: Any, links: Any, color: Sequence[float]) -> Any:
    rough = _surface(nodes, "ShaderNodeBsdfGlossy", color, 0.447)
    sharp = _surface(nodes, "ShaderNodeBsdfGlossy", color, 0.1)
    return _mix(nodes, links, 0.6, rough, sharp)
