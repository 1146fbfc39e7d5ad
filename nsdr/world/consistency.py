"""What the parts of a world may not have together."""

from dataclasses import replace
from itertools import product
from math import hypot

from nsdr.errors import DataError
from nsdr.world.camera import Camera
from nsdr.world.layout import START_SPACING, Layout
from nsdr.world.physics import Physics, Timeline
from nsdr.world.vocabulary import Shape, Vocabulary

MIN_OBJECT_PX = 4
"""Least width of an object in the middle of the area in which scenes happen (pixels): smaller ones have no shape that can be
seen."""
MAX_SIDE_PX = 4096
"""Largest image width and height that H.264 encoders take at every level (pixels)."""


def check_objects_fit(vocabulary: Vocabulary, layout: Layout) -> None:
    """Raise `DataError` unless the objects of every scene differ, and have space in the area in which they start."""
    most = layout.most_objects
    if vocabulary.n_triples < most:
        raise DataError(
            f"vocabulary: its words make {vocabulary.n_triples} combinations for scenes of {most} objects "
            "(layout.objects); no combination occurs twice in a scene"
        )
    x0, x1, y0, y1 = layout.area_world
    widest = max(shape.half_width_world for shape in vocabulary.shapes)
    needed = most * (START_SPACING * 2 * widest) ** 2
    if needed > (x1 - x0) * (y1 - y0):
        raise DataError(
            f"layout: area_world {list(layout.area_world)}: {most} objects of up to {2 * widest:g} world units do not "
            f"fit; expected an area of {needed:.3g} or more, got {(x1 - x0) * (y1 - y0):.3g}"
        )


def check_on_table(layout: Layout, physics: Physics) -> None:
    """Raise `DataError` unless objects start on the table."""
    reach = max(layout.far_world, *map(abs, layout.area_world))
    if reach > physics.table_half_width_world:
        raise DataError(
            f"layout: far_world and area_world reach to {reach:g}: expected the table's half width, "
            f"physics.table_half_width_world {physics.table_half_width_world:g}, or less"
        )


def check_in_view(vocabulary: Vocabulary, layout: Layout, camera: Camera) -> None:
    """Raise `DataError` unless the camera sees objects in the middle of the area, in images that a video can have."""
    x0, x1, y0, y1 = layout.area_world
    copy = replace(camera)  # what a camera keeps of its computations would be taken for settings
    column, row = copy.pixels([(x0 + x1) / 2, (y0 + y1) / 2, 0.0])
    if not (0 <= column <= camera.width and 0 <= row <= camera.height):  # NaN behind the camera
        raise DataError(
            f"camera: eye_world {list(camera.eye_world)}, target_world {list(camera.target_world)}: the middle of "
            f"layout.area_world {list(layout.area_world)} is not in the image"
        )
    thinnest = _thinnest(vocabulary)
    width = min(thinnest.size_world[:2]) * camera.focal_px / float(copy.depth([(x0 + x1) / 2, (y0 + y1) / 2, 0.0]))
    if width < MIN_OBJECT_PX:
        raise DataError(
            f"camera: in images of {camera.width}x{camera.height} with lens_mm {camera.lens_mm:g}, a {thinnest.word} in the "
            f"middle of layout.area_world is {width:.2g} pixels wide; expected {MIN_OBJECT_PX} or more"
        )
    if camera.width % 2 or camera.height % 2 or max(camera.width, camera.height) > MAX_SIDE_PX:
        raise DataError(
            f"camera: expected an even width and height of up to {MAX_SIDE_PX} pixels, as videos have, got "
            f"{camera.width}x{camera.height}"
        )


def check_objects_arrive(vocabulary: Vocabulary, physics: Physics, timeline: Timeline, layout: Layout) -> None:
    """Raise `DataError` unless an object gets from where the first one starts to the area in the time that is simulated."""
    frames = timeline.horizon_frame(timeline.frames)
    x0, x1, y0, y1 = layout.area_world
    away = layout.start_distance_world[0] - max(hypot(x, y) for x, y in product((x0, x1), (y0, y1)))
    fastest, seconds = physics.start_speed_world_per_s[1], frames * physics.frame_seconds
    least = min(s.friction * m.friction for s, m in product(vocabulary.shapes, vocabulary.materials)) * physics.gravity
    time = min(seconds, fastest / least) if least else seconds  # until it has stopped
    slid = fastest * time - least * time**2 / 2
    if slid < away:
        raise DataError(
            f"physics: start_speed_world_per_s {fastest:g}: objects slide by at most {slid:.3g} in the {frames} frames that "
            f"are simulated ({seconds:.3g} s); layout.area_world is {away:.3g} away from where they start "
            "(layout.start_distance_world)"
        )


def _thinnest(vocabulary: Vocabulary) -> Shape:
    return min(vocabulary.shapes, key=lambda shape: min(shape.size_world[:2]))


def check_motion(vocabulary: Vocabulary, physics: Physics) -> None:
    """Raise `DataError` unless objects meet as the simulators assume.

    Collisions are computed in the plane of the table; so two objects have to meet at a vertical wall, or at equal heights.
    """
    thinnest = _thinnest(vocabulary)
    fastest, half = physics.start_speed_world_per_s[1], min(thinnest.size_world[:2]) / 2
    if fastest * physics.step_seconds >= half:
        raise DataError(
            f"physics: start_speed_world_per_s {fastest:g}: in one step of {physics.step_seconds:g} s an object would "
            f"move by {fastest * physics.step_seconds:.3g}, and pass through shape {thinnest.word}, half of whose width "
            f"is {half:g}"
        )
    spheres = [shape for shape in vocabulary.shapes if shape.solid == "sphere"]
    for sphere, other in product(spheres, vocabulary.shapes):
        radius, height = sphere.size_world[2] / 2, other.size_world[2]
        if radius > height or (other.solid == "sphere" and 2 * radius != height):
            raise DataError(
                f"shapes {sphere.word} and {other.word}: a sphere with the radius {radius:g} meets one with the height "
                f"{height:g} above its middle and would lift it; expected spheres of one size, and other shapes at "
                "least as high as the radius"
            )
