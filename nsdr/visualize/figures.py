"""Matplotlib figures: the ground seen from above with its rollouts, and the causal graph over time."""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.errors import DataError
from nsdr.symbolic.causal import direct_causes
from nsdr.types import DynamicsPrediction, Rollout, Scene, SceneObject
from nsdr.world.camera import HEIGHT_PX, WIDTH_PX, ground_from_pixels
from nsdr.world.physics_constants import OBJECT_RADIUS_WORLD
from nsdr.world.timeline import FPS
from nsdr.world.vocabulary import COLORS_RGB

__all__ = ["causal_figure", "figure_png", "plan_figure"]

DPI = 150
"""Resolution of PNG files (dots per inch)."""
MARKERS = {"cube": "s", "sphere": "o", "cylinder": "h"}
"""Matplotlib marker of each shape."""
OBJECT_SIZE_PT = 15
"""Size of an object's marker (points)."""
STAR_SIZE_PT = 13
"""Size of a collision's star (points)."""
PLAN_X_LIMITS_WORLD = (-4, 4)
"""Horizontal extent of the plan: world y, to the right in the image (world units)."""
PLAN_Y_LIMITS_WORLD = (-3.4, 2.6)
"""Vertical extent of the plan: minus world x, away from the camera (world units)."""
FAR_EDGE_PX = 60
"""Image row up to which the visible ground is shaded (pixels from the top)."""
SAME_POSITION_WORLD = 0.05
"""A counterfactual trajectory is drawn dashed from the frame in which it is farther than this from the observed one
(world units)."""
MISSING_DIFFERENCE_WORLD = 9.0
"""Distance assumed where one of two compared trajectories is missing (world units), so that it counts as different."""


def plan_figure(prediction: DynamicsPrediction, removed: int | None = None) -> Any:
    """The ground from above: observed trajectories solid, predicted ones dashed, collisions as stars.

    Stars of observed collisions are filled; the number beside a star is the collision's frame.

    Args:
        prediction: from a dynamics backend.
        removed: id of the object whose removal is drawn; None draws the observed rollout.

    Returns:
        A matplotlib figure.

    Raises:
        DataError: matplotlib is missing.
    """
    plt = _pyplot()
    figure, axes = plt.subplots(figsize=(6, 4.6), constrained_layout=True)
    rollout = prediction.observed if removed is None else prediction.counterfactual[removed]
    corners_px = [(0, FAR_EDGE_PX), (0, HEIGHT_PX), (WIDTH_PX, HEIGHT_PX), (WIDTH_PX, FAR_EDGE_PX)]
    corners = ground_from_pixels(np.array(corners_px), 0.0)
    axes.fill(corners[:, 1], -corners[:, 0], color="0.96", zorder=0)
    if removed is not None:
        path = prediction.observed.location_world[removed, : prediction.n_frames]
        axes.plot(path[:, 1], -path[:, 0], color="0.75", lw=1.5, ls=":")
        _draw_object(axes, prediction.objects[removed], path[np.isfinite(path[:, 0])][-1], faint=True)
    for o in prediction.objects:
        if o.id != removed:
            _draw_trajectory(axes, o, rollout, prediction, removed)
    for event in rollout.collisions:
        x, y = np.nanmean([rollout.location_world[i, event.frame] for i in event.objects], 0)
        observed = event.frame < prediction.n_frames and (removed is None or event in prediction.observed.collisions)
        fill = "gold" if observed else "white"
        axes.plot(y, -x, "*", ms=STAR_SIZE_PT, mfc=fill, mec="black", mew=0.8, zorder=5)
        axes.annotate(f"{event.frame}", (y, -x), (6, 6), textcoords="offset points", fontsize=8, zorder=6)
    title = (
        "observed, then predicted (dashed)" if removed is None else f"without the {prediction.objects[removed].name}"
    )
    axes.set(aspect="equal", xlim=PLAN_X_LIMITS_WORLD, ylim=PLAN_Y_LIMITS_WORLD)
    axes.set(xlabel="y (right of the image)", ylabel="-x", title=title)
    return figure


def _draw_trajectory(
    axes: Any, o: SceneObject, rollout: Rollout, prediction: DynamicsPrediction, removed: int | None
) -> None:
    location, color = rollout.location_world[o.id], np.array(COLORS_RGB[o.color]) / 255
    predicted = np.arange(len(location)) >= prediction.n_frames - 1
    if removed is not None:
        observed = prediction.observed.location_world[o.id]
        distance = np.linalg.norm(np.nan_to_num(location - observed, nan=MISSING_DIFFERENCE_WORLD), axis=1)
        differs = distance > SAME_POSITION_WORLD
        differs[prediction.n_frames :] = True
        predicted = np.maximum.accumulate(differs)
        axes.plot(observed[:, 1], -observed[:, 0], color="0.8", lw=1)
    axes.plot(location[~predicted, 1], -location[~predicted, 0], color=color, lw=2)
    axes.plot(location[predicted, 1], -location[predicted, 0], color=color, lw=2, ls=(0, (3, 2)))
    during_video = location[: prediction.n_frames]
    during_video = during_video[np.isfinite(during_video[:, 0])]
    if len(during_video):
        _draw_object(axes, o, during_video[-1])


def _draw_object(axes: Any, o: SceneObject, location: NDArray[Any], faint: bool = False) -> None:
    x, y = location
    fill = np.array(COLORS_RGB[o.color]) / 255
    edge = {"mew": 2.0, "mec": "0.85"} if o.material == "metal" else {"mew": 0.8, "mec": "black"}
    opacity = 0.3 if faint else 1.0
    axes.plot(y, -x, MARKERS[o.shape], ms=OBJECT_SIZE_PT, mfc=fill, alpha=opacity, zorder=4, **edge)
    offset = OBJECT_RADIUS_WORLD * 1.2
    text = {"fontsize": 7.5, "color": "0.6" if faint else "0.15", "zorder": 6}
    axes.annotate(f"{o.id} {o.name}", (y + offset, -x - offset), **text)


def causal_figure(scene: Scene) -> Any:
    """Every object's line over time with its events; arrows lead from each event to the events it directly causes.

    Args:
        scene: with events of the video.

    Returns:
        A matplotlib figure.

    Raises:
        DataError: matplotlib is missing.
    """
    plt = _pyplot()
    n = len(scene.objects)
    figure, axes = plt.subplots(figsize=(8, 0.55 * n + 1.3), constrained_layout=True)
    for o in scene.objects:
        visible = np.flatnonzero(scene.visible[o.id])
        color = np.array(COLORS_RGB[o.color]) / 255
        if len(visible):
            axes.plot(visible[[0, -1]], [o.id, o.id], color=color, lw=3, solid_capstyle="round", zorder=2)
    positions = [(e.frame, float(np.mean(e.objects))) for e in scene.events]
    for event, position in zip(scene.events, positions, strict=True):
        if event.kind == "collision":
            axes.plot([event.frame] * 2, event.objects, color="black", lw=1.2, zorder=1)
            axes.plot([event.frame] * 2, event.objects, "o", color="black", ms=4, zorder=3)
            axes.plot(*position, "*", ms=STAR_SIZE_PT, mfc="gold", mec="black", zorder=5)
        else:
            axes.plot(*position, ">" if event.kind == "in" else "X", ms=9, mfc="white", mec="black", zorder=5)
    arrow = {"arrowstyle": "-|>", "color": "crimson", "lw": 1.4, "shrinkA": 7, "shrinkB": 7}
    for index, causes in enumerate(direct_causes(scene.events)):
        for cause in causes:
            curved = {**arrow, "connectionstyle": "arc3,rad=0.25"}
            axes.annotate("", positions[index], positions[cause], arrowprops=curved, zorder=4)
    axes.set(xlim=(-2, scene.n_frames + 1), ylim=(n - 0.4, -0.6), xlabel=f"frame ({FPS} a second)")
    axes.set_yticks(range(n), [f"{o.id} {o.name}" for o in scene.objects])
    axes.set_title("Events (star: collision, arrow head: enters, cross: leaves) and their direct causes", fontsize=9)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    return figure


def figure_png(figure: Any) -> bytes:
    """A matplotlib figure as the bytes of a PNG file; closes the figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    _pyplot().close(figure)
    return buffer.getvalue()


def _pyplot() -> Any:
    try:
        import matplotlib

        matplotlib.use("Agg")
        import matplotlib.pyplot as plt
    except ImportError as e:
        raise DataError("figures need matplotlib: pip install 'nsdr[visualize]'") from e
    return plt
