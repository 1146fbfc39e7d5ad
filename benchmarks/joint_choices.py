"""Does it help to know that hardly any counterfactual question has no correct choice (`nsdr.symbolic.joint`)?

`python benchmarks/joint_choices.py --scenes SCENES --truth TRUTH`: SCENES holds what `nsdr predict-dynamics --form scenes` made
of generated videos, TRUTH their `truth_N.json`. For every object that can be removed, questions are made up whose numbers of
correct choices are those of CLEVRER's training questions; the wrong choices are collisions that happen elsewhere in the video
where there are enough. Prints questions and choices that are judged wrong one by one, and together.
"""

import argparse
import random
from itertools import combinations
from pathlib import Path

from nsdr import Event, Scene, load
from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.evaluation import calibration
from nsdr.io.files import find_files
from nsdr.symbolic.joint import hardly_none, most_probable, probabilities
from nsdr.symbolic.possible_worlds import possible_scenes

CORRECT = {0: 169, 1: 7_947, 2: 6_406, 3: 4_120}
"""Counterfactual training questions by number of correct choices."""
CHOICES = (2, 3, 3, 4, 4, 4, 4)
"""Numbers of choices, as often as here."""
QUESTIONS = 12
"""Tries for each removed object; those without enough collisions are dropped."""
Pairs = set[frozenset[str]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=Path, required=True)
    parser.add_argument("--truth", type=Path, required=True)
    options = parser.parse_args()
    rng = random.Random(0)
    n_questions, wrong, wrong_choices, changed = 0, [0, 0], [0, 0], [0, 0]
    stated: dict[str, list[tuple[float, bool]]] = {"one by one": [], "together": []}
    for path in find_files(options.scenes, "scene_*.json"):
        scene = load(Scene, path)
        [file] = find_files(options.truth, f"truth_{path.name.split('.')[0].split('_')[1]}.json")
        truth = scene_from_truth(read_truth_file(file))
        worlds = possible_scenes(scene)
        for removed in [o.id for o in scene.objects if o.name in {t.name for t in truth.objects}]:
            found = named(scene, scene.counterfactual[removed])
            possible = [(n, named(world, world.counterfactual[removed])) for n, world in worlds]
            for choices, true in questions(truth, scene.objects[removed].name, rng):
                alone = tuple(c in found for c in choices)
                draws = [(n, tuple(c in happens for c in choices)) for n, happens in possible]
                together = alone if any(alone) else most_probable(hardly_none(draws))
                n_questions += 1
                for k, judged in enumerate((alone, together)):
                    wrong[k] += judged != true
                    wrong_choices[k] += sum(a != b for a, b in zip(judged, true, strict=True))
                if together != alone:
                    changed[together == true] += 1
                stated["one by one"] += zip(probabilities(draws), true, strict=True)
                stated["together"] += zip(probabilities(hardly_none(draws)), true, strict=True)
    print(f"{n_questions} questions, {len(stated['together'])} choices; judged together, {sum(changed)} change,")
    print(f"{changed[True]} of them to what is right")
    for k, (name, rows) in enumerate(stated.items()):
        c = calibration(*zip(*rows, strict=True))
        print(
            f"{name}: {wrong[k]} questions wrong, {wrong_choices[k]} choices; calibration error {100 * c['ece']:.2f} %, "
            f"Brier score {c['brier']:.4f}"
        )


def named(scene: Scene, events: tuple[Event, ...]) -> Pairs:
    """The colliding pairs by their names."""
    return {frozenset(scene.objects[i].name for i in e.objects) for e in events}


def questions(truth: Scene, removed: str, rng: random.Random) -> list[tuple[list[frozenset[str]], tuple[bool, ...]]]:
    """Choices about a video without an object, and which of them are correct."""
    [removed_id] = [o.id for o in truth.objects if o.name == removed]
    happens = named(truth, truth.counterfactual[removed_id])
    elsewhere = named(truth, tuple(e for e in truth.events if e.kind == "collision"))
    elsewhere |= named(truth, truth.unseen).union(*(named(truth, events) for events in truth.counterfactual.values()))
    names = sorted(o.name for o in truth.objects if o.name != removed)
    wrong = [pair for pair in map(frozenset, combinations(names, 2)) if pair not in happens]
    near = [pair for pair in wrong if pair in elsewhere]
    made = []
    for _ in range(QUESTIONS):
        n_choices = rng.choice(CHOICES)
        n_correct = min(rng.choices(list(CORRECT), list(CORRECT.values()))[0], n_choices)
        n_wrong = n_choices - n_correct
        pool = near if len(near) >= n_wrong else wrong
        if n_correct <= len(happens) and n_wrong <= len(pool):
            choices = rng.sample(sorted(happens, key=sorted), n_correct) + rng.sample(pool, n_wrong)
            made.append((choices, tuple(c in happens for c in choices)))
    return made


if __name__ == "__main__":
    main()
