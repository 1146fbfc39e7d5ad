"""Answering counterfactuals without any physics: the recording, with the removed object deleted from it.

A control: it is right wherever removing the object changes nothing else, so what a system must get right to understand anything
are the options that it gets wrong.
"""

from dataclasses import replace

from nsdr.types import Scene

__all__ = ["keep_recording"]


def keep_recording(scene: Scene) -> Scene:
    """The scene with the collisions of the video, except those of the removed object, as every counterfactual."""
    collisions = [e for e in scene.events if e.kind == "collision"]
    without = {o.id: tuple(e for e in collisions if o.id not in e.objects) for o in scene.objects}
    return replace(scene, counterfactual=without, dynamics=None, doubts=None)
