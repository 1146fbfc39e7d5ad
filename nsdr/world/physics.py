"""How objects move, and time in videos."""

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from nsdr.errors import DataError
from nsdr.validation import Checked, Positive, Share

DECIMALS = 12
"""Products of settings are rounded to so many decimals, so that 0.8 times 0.8 is 0.64."""


MIN_VIDEO_FRAMES = 10
"""Fewest frames of a video: collisions in the first ones are not planned."""
CONTACT_PAUSE_SECONDS = 0.28
"""Two objects that touch after more than this time without contact have collided again."""


@dataclass(frozen=True)
class Physics(Checked):
    """How objects move, in Bullet's terms. CLEVRER's values were recovered from the release's annotation files.

    Re-simulating ten of these from frame 0 gives the annotated collisions (`pytest -m real_data -k simulated_again`).

    Attributes:
        gravity: acceleration, downwards (world units/s²).
        linear_damping: Bullet's: an object with speed `v` loses `c v + c v²` per second.
        angular_damping: likewise, for the angular speed.
        spinning_friction: coefficient of torsional friction on the table.
        table_restitution: coefficient of restitution of the table (0-1).
        table_half_width_world: how far the table reaches from the origin along x and y (world units).
        step_seconds: time step (s).
        steps_per_frame: steps between two frames of a video.
        mass_range: of the uniformly distributed masses; only their ratios matter.
        start_speed_world_per_s: range of the initial speeds of moving objects (world units/s); the others start at rest.
        moving_speed_world_per_s: speed above which answers count an object as moving (world units/s).
    """

    gravity: Annotated[float, Meta(gt=0, le=100)] = 9.81
    linear_damping: Share = 0.04
    angular_damping: Share = 0.04
    spinning_friction: Share = 0.01
    table_restitution: Share = 0.5
    table_half_width_world: Annotated[float, Meta(ge=1, le=1000)] = 15.0
    step_seconds: Annotated[float, Meta(gt=0, le=0.02)] = 0.004
    steps_per_frame: Annotated[int, Meta(ge=1, le=50)] = 7
    mass_range: tuple[Positive, Positive] = (0.7, 1.3)
    start_speed_world_per_s: tuple[Positive, Positive] = (2.7, 3.0)
    moving_speed_world_per_s: Positive = 0.02

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("mass_range", "start_speed_world_per_s"):
            low, high = getattr(self, name)
            if low > high:
                raise DataError(f"physics: {name}: expected the smaller number first, got {low:g} and {high:g}")
        fastest = self.start_speed_world_per_s[1]
        if self.moving_speed_world_per_s >= fastest:
            raise DataError(
                f"physics: moving_speed_world_per_s {self.moving_speed_world_per_s:g}: nothing would count as moving; expected "
                f"less than the fastest start_speed_world_per_s, {fastest:g}"
            )

    @property
    def log_mass_std(self) -> float:
        """Standard deviation of the natural logarithm of masses in `mass_range`, to two decimals and at least 0.01."""
        low, high = self.mass_range
        return max(round((high - low) / (high + low) / 3**0.5, 2), 0.01)

    @property
    def contact_pause_steps(self) -> int:
        """`CONTACT_PAUSE_SECONDS` in steps: 70 in CLEVRER."""
        return round(CONTACT_PAUSE_SECONDS / self.step_seconds)

    @property
    def contact_pause_frames(self) -> int:
        """The same in whole frames."""
        return self.contact_pause_steps // self.steps_per_frame

    @property
    def frame_seconds(self) -> float:
        """Simulated time between two frames (s); velocities are per second of this time."""
        return round(self.steps_per_frame * self.step_seconds, DECIMALS)


@dataclass(frozen=True)
class Timeline(Checked):
    """Time in videos.

    Attributes:
        fps: frames per second of video time.
        frames: number of frames of a video.
        horizon: number of frames that are simulated, and of which "next" tells, for each frame of a video. CLEVRER simulates
            7 s of video time and shows the first 5 (paper, section 3.1).
    """

    fps: Annotated[int, Meta(ge=1, le=1000)] = 25
    frames: Annotated[int, Meta(ge=MIN_VIDEO_FRAMES)] = 128
    horizon: Annotated[float, Meta(ge=1, le=10)] = 1.4

    def horizon_frame(self, n_frames: int) -> int:
        """Number of frames that are simulated for a video of `n_frames`: 179 for 128 in CLEVRER.

        It is the last frame to predict, too, which agrees best with CLEVRER's own answers.
        """
        return round(n_frames * self.horizon)
