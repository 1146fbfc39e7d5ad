from .blender import Blender as Blender
from .geometry import Solid as Solid, instance_ids as instance_ids, optical_flow as optical_flow
from .preview import render_motion as render_motion, render_preview as render_preview
from .view import RenderConfig as RenderConfig, View as View, view_of as view_of
