"""Physical constants of CLEVRER's simulation in Bullet, and time in its videos.

Recovered from the release's annotation files: re-simulating ten of them from frame 0 with these values gives the annotated
collisions (`pytest -m real_data -k simulated_again`). Objects are 0.4 world units wide; seconds are simulated time.
"""

from nsdr.world.physics import DECIMALS, Physics, Timeline
from nsdr.world.vocabulary import Vocabulary

_PHYSICS, _TIMELINE, _VOCABULARY = Physics(), Timeline(), Vocabulary()
STEP_SECONDS = _PHYSICS.step_seconds
"""Bullet's time step (s)."""
STEPS_PER_FRAME = _PHYSICS.steps_per_frame
"""Bullet steps between two frames of a video."""
FRAME_SECONDS = _PHYSICS.frame_seconds
"""Simulated time between two frames (s), `STEPS_PER_FRAME * STEP_SECONDS`; velocities are per second of this time."""
GRAVITY = _PHYSICS.gravity
"""Gravitational acceleration, downwards (world units/s²)."""
LINEAR_DAMPING = _PHYSICS.linear_damping
"""Bullet's default for multibodies: an object with speed `v` loses `0.04 v + 0.04 v²` per second."""
ANGULAR_DAMPING = _PHYSICS.angular_damping
"""Bullet's default for multibodies: like `LINEAR_DAMPING`, for the angular speed."""
GROUND_FRICTION = {shape.word: shape.friction for shape in _VOCABULARY.shapes}
"""Friction coefficient of each shape on the ground; spheres slide and never spin."""
SLIDING_DECELERATION = GROUND_FRICTION["cube"] * GRAVITY
"""Deceleration of sliding cubes and cylinders by friction, in addition to damping (world units/s²)."""
SPINNING_FRICTION = _PHYSICS.spinning_friction
"""Torsional friction coefficient on the ground."""
OBJECT_RESTITUTION = _VOCABULARY.materials[0].restitution
"""Coefficient of restitution of each object; Bullet multiplies those of two colliding bodies."""
PAIR_RESTITUTION = round(OBJECT_RESTITUTION * OBJECT_RESTITUTION, DECIMALS)
"""Coefficient of restitution of a collision of two objects, `OBJECT_RESTITUTION` squared."""
GROUND_HALF_WIDTH_WORLD = _PHYSICS.table_half_width_world
"""The ground reaches this far from the origin along x and y (world units)."""
GROUND_RESTITUTION = _PHYSICS.table_restitution
"""Coefficient of restitution of the ground."""

OBJECT_RADIUS_WORLD = _VOCABULARY.shapes[0].size_world[0] / 2
"""Radius or half the edge length of every object, and the height of its centre above the ground (world units)."""
MASS_RANGE = _PHYSICS.mass_range
"""Range of the uniformly distributed masses; only their ratios matter."""
LOG_MASS_STD = 0.17
"""Standard deviation of the natural logarithm of masses in `MASS_RANGE`."""
START_SPEED_RANGE_WORLD_PER_S = _PHYSICS.start_speed_world_per_s
"""Range of the initial speeds of moving objects (world units/s); the others start at rest."""
MOVING_SPEED_WORLD_PER_S = _PHYSICS.moving_speed_world_per_s
"""Speed on the ground above which CLEVRER's answers count an object as moving (world units/s)."""

FPS = _TIMELINE.fps
"""Frame rate of the released videos (frames per second of video time)."""
VIDEO_FRAMES = _TIMELINE.frames
"""Number of frames of a released video, except three irregular ones (`nsdr.clevrer.files.annotations.IRREGULAR_VIDEOS`)."""
SAME_EVENT_FRAMES = 3
"""Events of one kind and one pair that are at most so many frames apart are taken as the same event."""
horizon_frame = _TIMELINE.horizon_frame
