"""Physical constants of CLEVRER's simulation in Bullet, and time in its videos.

Recovered from the release's annotation files: re-simulating ten of them from frame 0 with these values gives the annotated
collisions (`pytest -m real_data -k simulated_again`). Objects are 0.4 world units wide; seconds are simulated time.
"""

STEP_SECONDS = 0.004
"""Bullet's time step (s)."""
STEPS_PER_FRAME = 7
"""Bullet steps between two frames of a video."""
FRAME_SECONDS = 0.028
"""Simulated time between two frames (s), `STEPS_PER_FRAME * STEP_SECONDS`; velocities are per second of this time."""
GRAVITY = 9.81
"""Gravitational acceleration, downwards (world units/s²)."""
LINEAR_DAMPING = 0.04
"""Bullet's default for multibodies: an object with speed `v` loses `0.04 v + 0.04 v²` per second."""
ANGULAR_DAMPING = 0.04
"""Bullet's default for multibodies: like `LINEAR_DAMPING`, for the angular speed."""
GROUND_FRICTION = {"cube": 0.03, "cylinder": 0.03, "sphere": 0.0}
"""Friction coefficient of each shape on the ground; spheres slide and never spin."""
SLIDING_DECELERATION = GROUND_FRICTION["cube"] * GRAVITY
"""Deceleration of sliding cubes and cylinders by friction, in addition to damping (world units/s²)."""
SPINNING_FRICTION = 0.01
"""Torsional friction coefficient on the ground."""
OBJECT_RESTITUTION = 0.8
"""Coefficient of restitution of each object; Bullet multiplies those of two colliding bodies."""
PAIR_RESTITUTION = 0.64
"""Coefficient of restitution of a collision of two objects, `OBJECT_RESTITUTION` squared."""
GROUND_HALF_WIDTH_WORLD = 15.0
"""The ground reaches this far from the origin along x and y (world units)."""
GROUND_RESTITUTION = 0.5
"""Coefficient of restitution of the ground."""
ERROR_REDUCTION = 0.08
"""Bullet's default error reduction parameter (ERP): the fraction of a penetration that is corrected per step."""
CONTACT_THRESHOLD_WORLD = 0.02 * 0.348
"""Gap below which Bullet handles a contact (world units): 0.02 of the hulls' angular motion disc (0.348)."""
CONTACT_PAUSE_STEPS = 70
"""Two objects that touch after more than this number of steps without contact have collided again."""
MIN_REBOUND_SPEED = 0.2
"""Approach speed (world units/s) below which Bullet applies no restitution."""
HULL_MARGIN_WORLD = 0.001
"""Bullet's collision margin around every convex hull (world units)."""

OBJECT_RADIUS_WORLD = 0.2
"""Radius or half the edge length of every object, and the height of its centre above the ground (world units)."""
MASS_RANGE = (0.7, 1.3)
"""Range of the uniformly distributed masses; only their ratios matter."""
LOG_MASS_STD = 0.17
"""Standard deviation of the natural logarithm of masses in `MASS_RANGE`."""
START_SPEED_RANGE_WORLD_PER_S = (2.7, 3.0)
"""Range of the initial speeds of moving objects (world units/s); the others start at rest."""
MOVING_SPEED_WORLD_PER_S = 0.02
"""Speed on the ground above which CLEVRER's answers count an object as moving (world units/s)."""

FPS = 25
"""Frame rate of the released videos (frames per second of video time)."""
VIDEO_FRAMES = 128
"""Number of frames of a released video, except three irregular ones (`nsdr.clevrer.files.annotations.IRREGULAR_VIDEOS`)."""
SAME_EVENT_FRAMES = 3
"""Events of one kind and one pair that are at most so many frames apart are taken as the same event."""
_SIMULATED_PER_SHOWN = 7 / 5
"""Simulated frames per shown frame: CLEVRER simulates 7 s of video time and shows the first 5 (paper, section 3.1)."""


def horizon_frame(n_frames: int) -> int:
    """Number of frames that CLEVRER simulates for a video of `n_frames`: 179 for 128.

    It is the last frame to predict, too, which agrees best with CLEVRER's own answers.
    """
    return round(n_frames * _SIMULATED_PER_SHOWN)
