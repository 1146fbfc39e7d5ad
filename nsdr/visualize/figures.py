"""A Matplotlib figure of the ground seen from above with the trajectories of a rollout."""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nsdr.io.files import check_installed
from nsdr.types import DynamicsPrediction, Rollout
from nsdr.types.scenes import yaws
from nsdr.visualize.plan_frames import outline, reach, seen_ground

DPI = 150
"""Resolution of PNG files (dots per inch)."""
MARKERS = {"box": "s", "sphere": "o", "cylinder": "h"}
"""Matplotlib marker of each solid, in the legend."""
OBJECT_SIZE_PT = 15
"""Size of an object's marker in the legend, before its scale (points)."""
STAR_SIZE_PT = 13
"""Size of a collision's star (points)."""
PLAN_CORNERS_WORLD = ((-3.6, -2.4), (3.6, 2.6))
"""Smallest extent of the plan, lower left and upper right: world y, to the right in the image, and minus world x, away from
the camera (world units in CLEVRER). It grows until all objects are in it."""
PLAN_LARGEST_WORLD = 9.0
"""The plan never shows positions with a larger coordinate: they are errors of the prediction (world units in
CLEVRER)."""
PLAN_MARGIN_WORLD = 0.5
"""Space around the outermost position (world units)."""
PLAN_WIDTH_IN, LEGEND_WIDTH_IN = 7.5, 1.9
"""Widths of the plan and of the names beside it (inches)."""
NUMBER_OFFSET_PT = (6, 4)
"""From a collision to its number (points)."""


def plan_figure(prediction: DynamicsPrediction, removed: int | None = None) -> Any:
    """The ground from above with trajectories, and collisions as numbered stars.

    A trajectory is solid while its object is in the image, and dashed before it enters, after it leaves and after the video.
    Objects are drawn at the end of the solid part, in their size and with their heading where it is known.
    Stars of observed collisions are filled. The legend has the names of the objects and the frames of the collisions. With an
    object removed, grey lines are the trajectories with it. The shaded part of the ground is what the camera sees.

    Args:
        prediction: from a dynamics backend.
        removed: id of the object whose removal is drawn; None draws the observed rollout.

    Returns:
        A matplotlib figure.

    Raises:
        DataError: matplotlib is missing.
    """
    rollout = prediction.observed if removed is None else prediction.counterfactual[removed]
    low, high = _extent(prediction, rollout)
    height_in = PLAN_WIDTH_IN * float((high[1] - low[1]) / (high[0] - low[0]))
    figure = new_figure(PLAN_WIDTH_IN + LEGEND_WIDTH_IN, height_in)
    axes = figure.subplots()
    axes.fill(*_on_plan(seen_ground(prediction.world.camera)).T, color="0.96", zorder=0)
    words, last = prediction.world.vocabulary, prediction.n_frames - 1
    for o in prediction.objects:
        color = np.array(words.color(o.color).srgb) / 255
        drawn = prediction.observed if o.id == removed else rollout
        path, seen = _on_plan(drawn.location_world[o.id]), drawn.visible[o.id].copy()
        seen[last + 1 :] = False
        if o.id == removed:
            axes.plot(*_where(seen, path).T, color="0.75", lw=1.5, ls=":")
        else:
            if removed is not None:
                axes.plot(*_on_plan(prediction.observed.location_world[o.id]).T, color="0.8", lw=1)
            hidden = ~seen
            beside = hidden | np.append(hidden[1:], False) | np.append(False, hidden[:-1])  # no gaps between the lines
            axes.plot(*_where(seen, path).T, color=color, lw=2)
            axes.plot(*_where(beside, path).T, color=color, lw=2, ls=(0, (3, 2)))
        known = np.flatnonzero(seen & np.isfinite(path[:, 0]))
        if len(known):
            frame, shape, metallic = known[-1], words.shape(o.shape), words.material(o.material).metallic
            (width, edge), opacity = (2.0, "0.85") if metallic else (0.8, "black"), 0.3 if o.id == removed else 1.0
            corners = outline(shape, yaws(drawn)[o.id, frame]) + drawn.location_world[o.id, frame]
            axes.fill(*_on_plan(corners).T, fc=color, ec=edge, lw=width, alpha=opacity, zorder=4)
            style = {"ls": "", "ms": OBJECT_SIZE_PT, "mfc": color, "mew": width, "mec": edge, "alpha": opacity}
            axes.plot([], [], marker=MARKERS[shape.solid], label=f"{o.id} {o.name}", **style)
    for number, event in enumerate(rollout.collisions, 1):
        at = np.nanmean(_on_plan(rollout.location_world[list(event.objects), event.frame]), 0)
        observed = event.frame <= last and (removed is None or event in prediction.observed.collisions)
        style = {"ls": "", "ms": STAR_SIZE_PT, "mfc": "gold" if observed else "white", "mec": "black", "zorder": 5}
        axes.plot(*at, marker="*", label=f"{number}: frame {event.frame}", **style)
        axes.annotate(str(number), at, NUMBER_OFFSET_PT, textcoords="offset points", fontsize=8, zorder=6)
    title = (
        "seen (solid) and predicted (dashed)" if removed is None else f"without the {prediction.objects[removed].name}"
    )
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set(xlabel="y (right of the image)", ylabel="-x", title=title)
    figure.legend(loc="outside right upper", fontsize=8, markerscale=0.6, frameon=False)
    return figure


def _where(shown: NDArray[np.bool_], path: NDArray[Any]) -> NDArray[Any]:
    """The positions (F, 2) of the frames that are shown; NaN in others, where lines end."""
    return np.where(shown[:, None], path, np.nan)


def _on_plan(location_world: NDArray[Any]) -> NDArray[Any]:
    """Ground positions (…, 2) as the plan's horizontal and vertical coordinates."""
    return np.stack([location_world[..., 1], -location_world[..., 0]], -1)


def _extent(prediction: DynamicsPrediction, rollout: Rollout) -> tuple[NDArray[Any], NDArray[Any]]:
    """Lower left and upper right corner of the plan, which hold every position during the video and every collision."""
    paths = [r.location_world[:, : prediction.n_frames] for r in (prediction.observed, rollout)]
    met = [rollout.location_world[list(e.objects), e.frame] for e in rollout.collisions]
    points = _on_plan(np.concatenate([p.reshape(-1, 2) for p in (*paths, *met)]))
    scale = reach(prediction.world)
    points = points[(np.abs(points) <= PLAN_LARGEST_WORLD * scale).all(1)]
    smallest = np.array(PLAN_CORNERS_WORLD, float) * scale
    low = np.vstack([points - PLAN_MARGIN_WORLD, smallest[:1]]).min(0)
    return low, np.vstack([points + PLAN_MARGIN_WORLD, smallest[1:]]).max(0)


def figure_png(figure: Any) -> bytes:
    """A matplotlib figure as the bytes of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty matplotlib figure of that size (inches), made without pyplot, whose windows and settings are the user's.

    Raises:
        DataError: matplotlib is missing.
    """
    check_installed("matplotlib", "figures need matplotlib", "visualize")
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")
