"""Interventions on a video's objects: which objects they mean, what contradicts, and the simulation that backends return."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from nsdr.clevrer.files.scenes import enter_exit_events
from nsdr.dynamics.scene import scene_from_prediction
from nsdr.errors import DataError
from nsdr.types import (
    Add,
    DynamicsPrediction,
    Event,
    Freeze,
    Move,
    Remove,
    Rollout,
    Scene,
    SceneObject,
    SetMass,
    SetVelocity,
    Simulation,
)
from nsdr.types.interventions import Intervention
from nsdr.types.scenes import in_order
from nsdr.validation import BoolArray, FloatArray
from nsdr.world.camera import Camera

EXCLUSIVE = ({SetVelocity, Freeze}, {SetMass, Freeze}, {Move})
"""Interventions of which an object takes one. `Remove` excludes all others."""


class Changes:
    """Interventions with the ids of their objects. `resolve` makes it.

    Attributes:
        of: (id, intervention) of each one; added objects get the ids after the scene's.
        objects: the scene's identities, then those of added objects.
        removed, added: ids.
    """

    def __init__(self, of: Sequence[tuple[int, Intervention]], objects: Sequence[SceneObject]) -> None:
        self.of = tuple(of)
        self.removed = [i for i, change in of if isinstance(change, Remove)]
        new = [SceneObject(i, a.color, a.material, a.shape) for i, a in of if isinstance(a, Add)]
        self.added = [o.id for o in new]
        self.objects = (*objects, *new)


def find_object(objects: Sequence[SceneObject], wanted: str | int) -> int:
    """Id of the object that words or an id mean.

    Raises:
        DataError: none or several fit; lists the objects.
    """
    known = ", ".join(f"{o.id} {o.name}" for o in objects)
    if not isinstance(wanted, str):
        if wanted in range(len(objects)) and not isinstance(wanted, bool):
            return int(wanted)
        raise DataError(f"object {wanted}: expected an id of the scene's objects: {known}")
    words = set(wanted.lower().removeprefix("the ").split())
    fitting = [o.id for o in objects if words and words <= set(o.name.split())]
    if len(fitting) == 1:
        return fitting[0]
    found = "no object fits" if not fitting else f"{len(fitting)} objects fit; add words or give the id"
    raise DataError(f"{wanted!r}: {found}; the objects by id: {known}")


def resolve(
    interventions: Sequence[Intervention], objects: Sequence[SceneObject], visible: BoolArray, from_frame: int
) -> Changes:
    """Interventions with the ids of their objects, checked against each other and the video.

    Args:
        interventions: changes of the scene.
        objects: the video's.
        visible: (n, F) bool, whether each object is in the image at each frame of the video.
        from_frame: frame of the interventions.

    Raises:
        DataError: no list, no intervention, a frame outside of the video, an object that is unknown or not in the image at
            that frame, contradicting interventions, or a new object that is there already.
    """
    frames = visible.shape[1]
    if isinstance(from_frame, bool) or not isinstance(from_frame, int) or not 0 <= from_frame < frames:
        raise DataError(f"from_frame: expected a frame of the video, 0 to {frames - 1}, got {from_frame!r:.60}")
    if not isinstance(interventions, Sequence) or isinstance(interventions, str) or not interventions:
        got = "none" if interventions in ([], ()) else f"{interventions!r:.60}"
        raise DataError(
            f"interventions: expected a list, such as [nsdr.Remove('red cube')], of at least one, got {got}"
        )
    found: list[tuple[int, Intervention]] = []
    n_added = 0
    for change in interventions:
        if isinstance(change, Add):
            found.append((len(objects) + n_added, change))
            n_added += 1
        elif isinstance(change, Remove | SetMass | SetVelocity | Move | Freeze):
            i = find_object(objects, change.object)
            _check_there(change, objects[i], visible[i], from_frame)
            found.append((i, change))
        else:
            known = "Remove, SetMass, SetVelocity, Move, Freeze, Add"
            raise DataError(f"interventions: expected instances of {known}, got {change!r:.60}")
    changes = Changes(found, objects)
    _check_contradictions(changes, from_frame)
    return changes


def _check_there(change: Intervention, o: SceneObject, visible: BoolArray, frame: int) -> None:
    """Removal and masses also concern objects that enter later."""
    seen, what = np.flatnonzero(visible), f"{type(change).__name__} {o.name}: it is"
    if not len(seen):
        raise DataError(f"{what} never in the image")
    enters_later = frame < seen[0]
    if not visible[frame] and not (enters_later and isinstance(change, Remove | SetMass)):
        when = f"enters at frame {seen[0]}" if enters_later else f"leaves after frame {seen[-1]}"
        expected = f"expected a from_frame from {seen[0]} to {seen[-1]}"
        raise DataError(f"{what} not in the image at frame {frame}, it {when}; {expected}")


def _check_contradictions(changes: Changes, from_frame: int) -> None:
    kinds: dict[int, list[type]] = defaultdict(list)
    for i, change in changes.of:
        mine = kinds[i]
        mine.append(type(change))
        for one_of in (*EXCLUSIVE, set(mine) if Remove in mine else set()):
            names = [kind.__name__ for kind in mine if kind in one_of]
            if len(names) > 1:
                name = changes.objects[i].name
                raise DataError(f"{name}: {' and '.join(names)} contradict each other; give one of them")
    if len(changes.removed) == len(changes.objects):
        raise DataError(f"interventions: all {len(changes.objects)} objects are removed; nothing is left to simulate")
    there: set[str] = set()
    for o in changes.objects:
        if from_frame > 0 or o.id not in changes.removed:
            if o.name in there:
                raise DataError(f"Add {o.name}: the scene has one already; objects differ in color, material or shape")
            there.add(o.name)


def make_simulation(
    changes: Changes,
    n_frames: int,
    from_frame: int,
    original: Rollout,
    changed: Rollout,
    yaws: tuple[FloatArray, FloatArray],
    camera: Camera | None = None,
) -> Simulation:
    """A simulation with its events and scene.

    Args:
        changes: the interventions.
        n_frames: frames of the video.
        from_frame: frame of the interventions.
        original, changed: rollouts of the scene's objects and the added ones.
        yaws: (n, F) rotations of both (radians).
        camera: the camera that took the video; without it, motion in the image is not known.
    """
    placed = {i for i, change in changes.of if isinstance(change, Remove | Move | Add)}

    def happens(event: Event, first: int) -> bool:
        """Not that an intervention puts an object there or takes it away."""
        return event.kind == "collision" or event.frame != from_frame or first not in placed

    kept = [o.id for o in changes.objects if from_frame > 0 or o.id not in changes.removed]
    scene = _scene(changes.objects, n_frames, changed, kept, camera)
    return Simulation(
        changes.objects,
        n_frames,
        from_frame,
        tuple(
            change if isinstance(change, Add) else replace(change, object=changes.objects[i].name)
            for i, change in changes.of
        ),
        original,
        changed,
        *yaws,
        _events(original),
        tuple(e for e in _events(changed) if happens(e, e.objects[0])),
        replace(scene, events=tuple(e for e in scene.events if happens(e, kept[e.objects[0]]))),
    )


def _events(rollout: Rollout) -> tuple[Event, ...]:
    return in_order([*enter_exit_events(rollout.visible), *rollout.collisions])


def _scene(
    objects: Sequence[SceneObject], n_frames: int, rollout: Rollout, kept: Sequence[int], camera: Camera | None
) -> Scene:
    """The scene of a rollout with some of its objects, renumbered."""
    new = {old: i for i, old in enumerate(kept)}

    def renumbered(event: Event) -> Event:
        return replace(event, objects=tuple(new[i] for i in event.objects))

    uncertain, speed = rollout.uncertain, rollout.speed_world_per_s
    part = Rollout(
        rollout.location_world[kept],
        rollout.visible[kept],
        tuple(renumbered(e) for e in rollout.collisions),
        None,
        None if speed is None else speed[kept],
        None if uncertain is None else tuple(replace(one, event=renumbered(one.event)) for one in uncertain),
    )
    prediction = DynamicsPrediction(tuple(replace(objects[i], id=new[i]) for i in kept), n_frames, part)
    return replace(scene_from_prediction(prediction, camera=camera), counterfactual=None, dynamics=prediction)


def simulate_removal(
    prediction: DynamicsPrediction,
    interventions: Sequence[Intervention],
    from_frame: int,
    backend: str,
    camera: Camera | None = None,
) -> Simulation:
    """The simulation of a backend that takes no interventions: one object is removed from frame 0.

    Yaws are not known, and are 0.

    Args:
        prediction: of the video.
        interventions: changes of the scene.
        from_frame: their frame.
        backend: its name, for the error.
        camera: the camera that took the video; without it, motion in the image is not known.

    Raises:
        DataError: other interventions, or those that `resolve` refuses.
    """
    n_frames = prediction.n_frames
    changes = resolve(interventions, prediction.objects, prediction.observed.visible[:, :n_frames], from_frame)
    if from_frame != 0 or len(changes.of) > 1 or not changes.removed:
        asked = ", ".join(type(change).__name__ for _, change in changes.of)
        raise DataError(
            f"{asked} from frame {from_frame}: the dynamics backend {backend} can only remove one object from frame 0; "
            "use the backend physics"
        )
    changed = prediction.counterfactual[changes.removed[0]]
    if changed.uncertain is not None:
        changed = replace(changed, uncertain=tuple(replace(one, removed=None) for one in changed.uncertain))
    original = replace(prediction.observed, unseen_scores=None)
    none = np.zeros(changed.visible.shape)
    return make_simulation(changes, n_frames, 0, original, changed, (none, none), camera)
