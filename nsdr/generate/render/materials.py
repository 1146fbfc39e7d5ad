"""Blender shader nodes of the substitutes for CLEVR's two materials."""

from collections.abc import Sequence
from typing import Any

__all__ = ["metal_surface", "rubber_surface"]

VELVET_ROUGHNESS, RUBBER_GLOSS_ROUGHNESS = 0.6, 0.59
"""Roughness of rubber's velvet-like and glossy surfaces."""
RUBBER_GLOSS_COLOR = (0.8, 0.8, 0.8, 1.0)
"""Linear RGBA of rubber's gloss."""
VELVET_IOR, RUBBER_GLOSS_IOR = 1.2, 1.25
"""Refractive indices of the Fresnel factors that mix rubber's surfaces."""
METAL_ROUGH, METAL_SHARP = 0.447, 0.1
"""Roughness of metal's two glossy surfaces."""
METAL_SHARP_SHARE = 0.6
"""Share of metal's sharper gloss."""


def rubber_surface(nodes: Any, links: Any, color: Sequence[float]) -> Any:
    """Rubber: a diffuse and a velvet-like surface under a faint gloss. Returns its shader output."""
    diffuse = _surface(nodes, "ShaderNodeBsdfDiffuse", color)
    velvet = _surface(nodes, "ShaderNodeBsdfSheen", color, VELVET_ROUGHNESS)
    gloss = _surface(nodes, "ShaderNodeBsdfGlossy", RUBBER_GLOSS_COLOR, RUBBER_GLOSS_ROUGHNESS)
    soft = _mix(nodes, links, _fresnel(nodes, VELVET_IOR), diffuse, velvet)
    return _mix(nodes, links, _fresnel(nodes, RUBBER_GLOSS_IOR), soft, gloss)


def metal_surface(nodes: Any, links: Any, color: Sequence[float]) -> Any:
    """Metal: a rough and a sharp gloss. Returns its shader output."""
    rough = _surface(nodes, "ShaderNodeBsdfGlossy", color, METAL_ROUGH)
    sharp = _surface(nodes, "ShaderNodeBsdfGlossy", color, METAL_SHARP)
    return _mix(nodes, links, METAL_SHARP_SHARE, rough, sharp)


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
