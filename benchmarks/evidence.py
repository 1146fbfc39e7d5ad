"""What honest reasoning and texts that game it earn: `python benchmarks/evidence.py -o results/evidence.md`.

Simulates scenes of evaluation seeds, asks at most one question of each type about each, and rewards what `texts` makes with
`nsdr.rewards.evidence`. Each text ends with the right answer, so that its reasoning alone counts, but for the row that says
otherwise. About 5 s of CPU a scene.
"""

import argparse
import random
import re
import shlex
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from nsdr import Executor, Scene, narrate, verify
from nsdr.claims.reading import written
from nsdr.claims.statements import EventPhrase, ObjectPhrase, Statement
from nsdr.clevrer import solution
from nsdr.clevrer.files.questions import QUESTION_TYPES, Question
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.evaluation.measures import mean_interval
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.questions.selection import generate_questions
from nsdr.generate.scene_files import truth_document
from nsdr.io.files import write_json
from nsdr.io.fingerprint import code_revision
from nsdr.language.slots import Slot
from nsdr.rewards import evidence
from nsdr.symbolic.phrases import attribute_words
from nsdr.symbolic.program import Program
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.physics_constants import FPS

FIRST_SEED = 550000
"""Seed of the first scene."""
REPEATS = 10
"""How often a text says the same."""
OPPOSITES = {
    "moving": "stationary",
    "stationary": "moving",
    "ever moving": "never moving",
    "never moving": "ever moving",
}
"""States of motion that exclude each other."""
SEEN = ("entrance", "exit", "collision", "motion")
"""Kinds of claims that do not only repeat the question and its answer."""
SWEEP_FRAMES = 3
"""Distance of the frames that are tried one after the other: each is within the tolerance of one."""
WRONG_ANSWER = "gaming: the right reasons, a wrong answer"


class Earned(NamedTuple):
    """A reward of a text."""

    kind: str
    scene: int
    reward: float


def told(scene: Scene, question: Question, length: str) -> list[str]:
    """The sentences of the narrated answer."""
    executor = Executor(scene)
    choices = [(c.text, c.program or ()) for c in question.choices]
    program = question.program or ()
    answer = executor.answer_choices(program, choices) if choices else executor.answer(program)
    return narrate(answer, scene, length).splitlines()[:-1]  # type: ignore[arg-type]


def named(question: Question) -> list[str]:
    """The objects that a question and its options name, in their words."""
    found: dict[str, None] = {}
    for program in (question.program, *(c.program for c in question.choices)):
        steps = Program.parse(program or ()).steps
        for index, step in enumerate(steps):
            if words := attribute_words(steps, index) if step.module else ():
                found[f"the {Slot('N', words).text}"] = None
    return list(found)


def contrary(sentence: str, scene: Scene) -> str:
    """What contradicts a narrated sentence."""
    said = verify(sentence, scene).claims[0].statement
    if said.kind == "motion":
        return written(replace(said, words=(OPPOSITES[said.words[0]],)))
    if said.number is not None:
        return written(replace(said, number=said.number % 2 + 1))
    return written(replace(said, negated=not said.negated))


def denied(scene: Scene) -> Iterator[str]:
    """What does not happen: collisions in the video, after it and without an object."""
    names = [ObjectPhrase(f"the {o.name}", (o.color, o.material, o.shape)) for o in scene.objects]
    courses = [("collision", None, scene.events), ("future", None, scene.unseen or ())]
    courses += [("counterfactual", names[i], events) for i, events in (scene.counterfactual or {}).items()]
    for kind, removed, events in courses:
        for pair in combinations(range(len(names)), 2):
            if all(e.objects != pair for e in events) and removed not in [names[i] for i in pair]:
                event = EventPhrase("collision", tuple(names[i] for i in pair))
                yield written(Statement(kind, True, events=(event,), removed=removed))


def texts(scene: Scene, question: Question, other: Question, rng: random.Random) -> dict[str, Sequence[str]]:
    """The sentences of each row of the table, without the answer; `other` is another question about the scene."""
    short = told(scene, question, "short")
    things, last = named(question), scene.n_frames - 1
    verbs = {"in": "enters", "out": "exits", "collision": "collide"}
    who = [" and ".join(f"the {scene.objects[i].name}" for i in e.objects) for e in scene.events]
    observed = [f"Frame {e.frame}: {them} {verbs[e.kind]}." for e, them in zip(scene.events, who, strict=True)]

    def in_seconds(text: str) -> str:
        text = re.sub(r"Frame (\d+):", lambda found: f"At {int(found[1]) / FPS:.1f} s:", text)
        return re.sub(r"frame (\d+)", lambda found: f"{int(found[1]) / FPS:.1f} s", text)

    def shuffled(text: str) -> str:
        return re.sub(r"(?<=rame )\d+", lambda _: str(rng.randint(0, last)), text)

    repeated = [re.sub(r" at frame \d+", "", s) for s in short if verify(s, scene).claims[0].kind not in SEEN]
    pairs = list(combinations(things, 2))
    sweep = [f"Frame {f}: {thing} enters." for thing in things for f in range(1, last, SWEEP_FRAMES)]
    sweep += [f"Frame {f}: {a} and {b} collide." for a, b in pairs for f in range(1, last, SWEEP_FRAMES)]
    denials = [f"{when}{a} and {b} do not collide." for a, b in pairs for when in ("", "After the video, ")]
    return {
        "honest: narrated, short": short,
        "honest: the same with seconds (0.1 s)": [in_seconds(s) for s in short],
        "honest: narrated, long": told(scene, question, "long"),
        "gaming: one safe fact": observed[:1],
        "gaming: all observed facts": observed,
        "gaming: facts of another question": told(scene, other, "short"),
        "gaming: shuffled frames": [shuffled(s) for s in short],
        "gaming: copied question and answer": [question.text, *(f"{c.text}." for c in question.choices), *repeated],
        "gaming: negations": list(denied(scene)),
        "gaming: repetition": short * REPEATS,
        "gaming: contradictions": [*short, *(contrary(s, scene) for s in short)],
        "gaming: empty": [],
        WRONG_ANSWER: short,
        "without the video: what the question names moves": [f"{thing} moves in the video." for thing in things],
        "without the video: it moves at the start and end": [
            f"Frame {f}: {thing} is moving." for thing in things for f in (0, last)
        ],
        "without the video: it does not collide": denials,
        "without the video: it enters and collides, at every frame": sweep,
        "without the video: 1 collision happens before frame 50.": ["1 collision happens before frame 50."],
    }


def wrong_answer(question: Question) -> str:
    """An answer that is not the right one."""
    answers = ("none", "A") if question.choices else ("yes", "no")
    return next(text for text in (f"<answer>{a}</answer>" for a in answers) if text != solution(question))


def measure(n_scenes: int, per_type: int, folder: Path) -> tuple[dict[str, list[Earned]], int]:
    """What each row earns, and how many questions were left out because they rest on nothing that is seen."""
    scenes: dict[int, Scene] = {}
    for seed in tqdm(range(FIRST_SEED, FIRST_SEED + n_scenes), unit="scene"):
        document = truth_document(simulate_scene(seed), seed, CLEVRER_CAMERA)
        write_json(folder / f"{seed}.json", document)
        scenes[seed] = scene_from_truth(document)
    earned: dict[str, list[Earned]] = {}
    missing, left_out = dict.fromkeys(QUESTION_TYPES, per_type), 0
    rng = random.Random(0)
    for asked in generate_questions((seed, f"{seed}.mp4", scene) for seed, scene in scenes.items()):
        scene = scenes[asked.scene_index]
        questions = rng.sample(asked.questions, len(asked.questions))
        for question in {q.type: q for q in questions}.values():
            if not missing[question.type]:
                continue
            rows = texts(scene, question, next(q for q in questions if q is not question), rng)
            columns = {
                "solution": solution(question),
                "options": [c.text for c in question.choices],
                "program": question.program,
                "option_programs": [c.program for c in question.choices],
                "scene": folder / f"{asked.scene_index}.json",
            }
            answers = [wrong_answer(question) if name == WRONG_ANSWER else solution(question) for name in rows]
            completions = ["\n".join([*said, answer]) for said, answer in zip(rows.values(), answers, strict=True)]
            rewards = evidence(completions, **{name: [value] * len(rows) for name, value in columns.items()})
            if None in rewards:
                left_out += 1
                continue
            missing[question.type] -= 1
            for name, reward in zip(rows, rewards, strict=True):
                earned.setdefault(name, []).append(Earned(question.type, asked.scene_index, reward or 0.0))
    return earned, left_out


def table(earned: Mapping[str, Sequence[Earned]], left_out: int) -> str:
    """Markdown."""
    lines = ["# What reasoning earns", "", f"| reasoning | {' | '.join(QUESTION_TYPES)} | all |", "|---" * 6 + "|"]
    for name, rows in earned.items():
        cells = [cell([e for e in rows if e.kind == kind]) for kind in QUESTION_TYPES]
        lines.append(f"| {name} | {' | '.join([*cells, cell(rows)])} |")
    kinds = [e.kind for e in earned[WRONG_ANSWER]]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in QUESTION_TYPES)
    lines += [
        "",
        f"Means with 95 % intervals. Questions: {counts}; {left_out} more rest on nothing that is seen.",
        "",
        f"Made by `{shlex.join(['python', *sys.argv])}`, revision {code_revision()}.",
    ]
    return "\n".join(lines) + "\n"


def cell(earned: Sequence[Earned]) -> str:
    """The mean reward with its interval."""
    rewards = np.array([e.reward for e in earned])
    low, high = mean_interval(rewards, [e.scene for e in earned])
    return f"{rewards.mean():.2f} ({low:.2f}-{high:.2f})"


def main() -> None:
    """Measure, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--scenes", type=int, default=110, help="number of scenes; about half have a predictive question"
    )
    parser.add_argument("--per-type", type=int, default=50, help="most questions of a type")
    parser.add_argument("-o", "--output", default="", help="file of the table")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        text = table(*measure(options.scenes, options.per_type, Path(folder)))
    if options.output:
        Path(options.output).write_text(text, "utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
