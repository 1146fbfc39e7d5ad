from .blender import Blender as Blender
from .motion import render_motion as render_motion
from .preview import render_preview as render_preview
from .raycast import Solid as Solid, instance_ids as instance_ids
from .view import RenderConfig as RenderConfig, View as View, view_of as view_of
