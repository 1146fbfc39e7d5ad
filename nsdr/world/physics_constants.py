"""Physical constants of CLEVRER's simulation in Bullet, and time in its videos.

Recovered from the release's annotation files: re-simulating ten of them from frame 0 with these values gives the annotated
collisions (`pytest -m real_data -k simulated_again`). Objects are 0.4 world units wide; seconds are simulated time.
"""

from nsdr.world.physics import Physics, Timeline
from nsdr.world.vocabulary import Vocabulary

_PHYSICS, _TIMELINE, _VOCABULARY = Physics(), Timeline(), Vocabulary()
FRAME_SECONDS = _PHYSICS.frame_seconds
"""Simulated time between two frames (s); velocities are per second of this time."""
GROUND_FRICTION = {shape.word: shape.friction for shape in _VOCABULARY.shapes}
"""Friction coefficient of each shape on the ground; spheres slide and never spin."""
GROUND_HALF_WIDTH_WORLD = _PHYSICS.table_half_width_world
"""The ground reaches this far from the origin along x and y (world units)."""

OBJECT_RADIUS_WORLD = _VOCABULARY.shapes[0].size_world[0] / 2
"""Radius or half the edge length of every object, and the height of its centre above the ground (world units)."""
MOVING_SPEED_WORLD_PER_S = _PHYSICS.moving_speed_world_per_s
"""Speed on the ground above which CLEVRER's answers count an object as moving (world units/s)."""

FPS = _TIMELINE.fps
"""Frame rate of the released videos (frames per second of video time)."""
VIDEO_FRAMES = _TIMELINE.frames
"""Number of frames of a released video, except three irregular ones (`nsdr.clevrer.files.annotations.IRREGULAR_VIDEOS`)."""
SAME_EVENT_FRAMES = 3
"""Events of one kind and one pair that are at most so many frames apart are taken as the same event."""
horizon_frame = _TIMELINE.horizon_frame
