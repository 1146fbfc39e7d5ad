"""Figures by matplotlib: the scene from above with its future and counterfactuals, and the causal graph over time."""

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

MARKERS = {"cube": "s", "sphere": "o", "cylinder": "h"}


def plan_figure(prediction: DynamicsPrediction, removed: int | None = None) -> Any:
    """The ground seen from above: observed ways as lines, what is predicted dashed, collisions as stars.

    Args:
        prediction: of the dynamics predictor.
        removed: the object whose removal is drawn; None draws the world as it is.

    Returns:
        A matplotlib figure.
    """
    plt = _pyplot()
    figure, axes = plt.subplots(figsize=(6, 4.6), constrained_layout=True)
    rollout = prediction.observed if removed is None else prediction.counterfactual[removed]
    corners = ground_from_pixels(np.array([(0, 60), (0, HEIGHT_PX), (WIDTH_PX, HEIGHT_PX), (WIDTH_PX, 60)]), 0.0)
    axes.fill(corners[:, 1], -corners[:, 0], color="0.96", zorder=0)
    if removed is not None:
        gone = prediction.observed.location_world[removed, : prediction.n_frames]
        axes.plot(gone[:, 1], -gone[:, 0], color="0.75", lw=1.5, ls=":")
        _object(axes, prediction.objects[removed], gone[np.isfinite(gone[:, 0])][-1], faint=True)
    for o in prediction.objects:
        if o.id != removed:
            _way(axes, o, rollout, prediction, removed)
    for event in rollout.collisions:
        position = np.nanmean([rollout.location_world[i, event.frame] for i in event.objects], 0)
        seen = event.frame < prediction.n_frames and (removed is None or event in prediction.observed.collisions)
        axes.plot(
            position[1], -position[0], "*", ms=13, mfc="gold" if seen else "white", mec="black", mew=0.8, zorder=5
        )
        axes.annotate(
            f"{event.frame}", (position[1], -position[0]), (6, 6), textcoords="offset points", fontsize=8, zorder=6
        )
    what = "observed, then predicted (dashed)" if removed is None else f"without the {prediction.objects[removed].name}"
    axes.set(aspect="equal", xlim=(-4, 4), ylim=(-3.4, 2.6), xlabel="y (right of the image)", ylabel="-x", title=what)
    return figure


def _way(axes: Any, o: SceneObject, rollout: Rollout, prediction: DynamicsPrediction, removed: int | None) -> None:
    position, color = rollout.location_world[o.id], np.array(COLORS_RGB[o.color]) / 255
    predicted = np.arange(len(position)) >= prediction.n_frames - 1
    if removed is not None:
        true = prediction.observed.location_world[o.id]
        away = np.linalg.norm(np.nan_to_num(position - true, nan=9.0), axis=1) > 0.05
        away[prediction.n_frames :] = True
        predicted = np.maximum.accumulate(away)
        axes.plot(true[:, 1], -true[:, 0], color="0.8", lw=1)
    axes.plot(position[~predicted, 1], -position[~predicted, 0], color=color, lw=2)
    axes.plot(position[predicted, 1], -position[predicted, 0], color=color, lw=2, ls=(0, (3, 2)))
    last = position[: prediction.n_frames]
    last = last[np.isfinite(last[:, 0])]
    if len(last):
        _object(axes, o, last[-1])


def _object(axes: Any, o: SceneObject, position: NDArray[Any], faint: bool = False) -> None:
    color = np.array(COLORS_RGB[o.color]) / 255
    shine = {"mew": 2.0, "mec": "0.85"} if o.material == "metal" else {"mew": 0.8, "mec": "black"}
    axes.plot(
        position[1], -position[0], MARKERS[o.shape], ms=15, mfc=color, alpha=0.3 if faint else 1.0, zorder=4, **shine
    )
    offset = OBJECT_RADIUS_WORLD * 1.2
    text = {"fontsize": 7.5, "color": "0.6" if faint else "0.15", "zorder": 6}
    axes.annotate(f"{o.id} {o.name}", (position[1] + offset, -position[0] - offset), **text)


def causal_figure(scene: Scene) -> Any:
    """Every object's line over time with its events; arrows lead from each event to those it is a direct cause of.

    Returns:
        A matplotlib figure.
    """
    plt = _pyplot()
    n = len(scene.objects)
    figure, axes = plt.subplots(figsize=(8, 0.55 * n + 1.3), constrained_layout=True)
    for o in scene.objects:
        shown = np.flatnonzero(scene.visible[o.id])
        color = np.array(COLORS_RGB[o.color]) / 255
        if len(shown):
            axes.plot(shown[[0, -1]], [o.id, o.id], color=color, lw=3, solid_capstyle="round", zorder=2)
    where = [(e.frame, float(np.mean(e.objects))) for e in scene.events]
    for event, position in zip(scene.events, where, strict=True):
        if event.kind == "collision":
            axes.plot([event.frame] * 2, event.objects, color="black", lw=1.2, zorder=1)
            axes.plot([event.frame] * 2, event.objects, "o", color="black", ms=4, zorder=3)
            axes.plot(*position, "*", ms=13, mfc="gold", mec="black", zorder=5)
        else:
            axes.plot(*position, ">" if event.kind == "in" else "X", ms=9, mfc="white", mec="black", zorder=5)
    arrow = {"arrowstyle": "-|>", "color": "crimson", "lw": 1.4, "shrinkA": 7, "shrinkB": 7}
    for index, causes in enumerate(direct_causes(scene.events)):
        for cause in causes:
            bend = {**arrow, "connectionstyle": "arc3,rad=0.25"}
            axes.annotate("", where[index], where[cause], arrowprops=bend, zorder=4)
    axes.set(xlim=(-2, scene.n_frames + 1), ylim=(n - 0.4, -0.6), xlabel=f"frame ({FPS} a second)")
    axes.set_yticks(range(n), [f"{o.id} {o.name}" for o in scene.objects])
    axes.set_title("Events (star: collision, arrow head: enters, cross: leaves) and their direct causes", fontsize=9)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    return figure


def figure_png(figure: Any) -> bytes:
    """A figure as the bytes of a PNG file; the figure is closed."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
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
