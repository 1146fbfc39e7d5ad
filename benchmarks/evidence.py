"""What honest reasoning and texts that game it earn, and whether narrated sentences hold.

    python -m benchmarks.evidence -o results/evidence.md
    python -m benchmarks.evidence --questions QUESTIONS.json --data FOLDER [--source truth] [--videos 60]

The first command simulates scenes of evaluation seeds, asks at most one question of each type about each, and rewards what
`texts` makes with `nsdr.rewards.evidence`. Each text ends with the right answer, so that its reasoning alone counts, except in
the row that says otherwise. About 5 s of CPU a scene.

The second command narrates the answers to questions, and reads the sentences back: how many hold, and how long that takes.
Questions that fail in the scene (where the source does not know what they need) are left out and counted.
"""

import random
import re
import tempfile
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from benchmarks.shared import made_by, parser_of, show, table
from nsdr import Answer, Executor, NsdrError, Scene, narrate, verify
from nsdr.claims.reading import written
from nsdr.claims.statements import EventPhrase, ObjectPhrase, Statement
from nsdr.clevrer import solution
from nsdr.clevrer.files.questions import QUESTION_TYPES, Question, read_questions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.evaluation.measures import mean_interval
from nsdr.evaluation.sources import SOURCES
from nsdr.generate.physics.scene import simulate_scene
from nsdr.generate.questions.selection import generate_questions
from nsdr.generate.scene_files import truth_document
from nsdr.io.files import write_json
from nsdr.rewards import evidence
from nsdr.symbolic.phrases import attribute_words
from nsdr.symbolic.program import Program
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import CLEVRER
from nsdr.world.world import CLEVRER_WORLD

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


def answered(scene: Scene, question: Question) -> Answer:
    """The answer by the question's programs."""
    executor, program = Executor(scene), question.program or ()
    choices = [(c.text, c.program or ()) for c in question.choices]
    return executor.answer_choices(program, choices) if choices else executor.answer(program)


def told(scene: Scene, question: Question, length: str) -> list[str]:
    """The sentences of the narrated answer."""
    return narrate(answered(scene, question), scene, length).splitlines()[:-1]  # type: ignore[arg-type]


def named_objects(question: Question) -> list[str]:
    """The objects that a question and its options name, in their words."""
    found: dict[str, None] = {}
    for program in (question.program, *(c.program for c in question.choices)):
        steps = Program.parse(program or ()).steps
        for index, step in enumerate(steps):
            if words := attribute_words(steps, index) if step.module else ():
                found[f"the {CLEVRER.noun_phrase(words)}"] = None
    return list(found)


def contrary(sentence: str, scene: Scene) -> str:
    """What contradicts a narrated sentence."""
    said = verify(sentence, scene).claims[0].statement
    if said.kind == "motion":
        return written(replace(said, words=(OPPOSITES[said.words[0]],)), CLEVRER)
    if said.number is not None:
        return written(replace(said, number=said.number % 2 + 1), CLEVRER)
    return written(replace(said, negated=not said.negated), CLEVRER)


def denied(scene: Scene) -> Iterator[str]:
    """What does not happen: collisions in the video, after it and without an object."""
    names = [ObjectPhrase(f"the {o.name}", (o.color, o.material, o.shape)) for o in scene.objects]
    courses = [("collision", None, scene.events), ("future", None, scene.predicted or ())]
    courses += [("counterfactual", names[i], events) for i, events in (scene.counterfactual or {}).items()]
    for kind, removed, events in courses:
        for pair in combinations(range(len(names)), 2):
            if all(e.objects != pair for e in events) and removed not in [names[i] for i in pair]:
                event = EventPhrase("collision", tuple(names[i] for i in pair))
                yield written(Statement(kind, True, events=(event,), removed=removed), CLEVRER)


def texts(scene: Scene, question: Question, other: Question, rng: random.Random) -> dict[str, Sequence[str]]:
    """The sentences of each row of the table, without the answer; `other` is another question about the scene."""
    short = told(scene, question, "short")
    things, last = named_objects(question), scene.n_frames - 1
    verbs = {"in": "enters", "out": "exits", "collision": "collide"}
    who = [" and ".join(f"the {scene.objects[i].name}" for i in e.objects) for e in scene.events]
    observed = [f"Frame {e.frame}: {them} {verbs[e.kind]}." for e, them in zip(scene.events, who, strict=True)]

    def in_seconds(text: str) -> str:
        text = re.sub(r"Frame (\d+):", lambda found: f"At {int(found[1]) / CLEVRER_WORLD.timeline.fps:.1f} s:", text)
        return re.sub(r"frame (\d+)", lambda found: f"{int(found[1]) / CLEVRER_WORLD.timeline.fps:.1f} s", text)

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


def table_of(earned: Mapping[str, Sequence[Earned]], left_out: int) -> str:
    """Markdown."""
    rows = []
    for name, of_name in earned.items():
        rows.append((name, *(cell([e for e in of_name if e.kind == kind]) for kind in QUESTION_TYPES), cell(of_name)))
    kinds = [e.kind for e in earned[WRONG_ANSWER]]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in QUESTION_TYPES)
    head = "# What reasoning earns\n\n" + table(("reasoning", *QUESTION_TYPES, "all"), rows)
    counted = f"Means with 95 % intervals. Questions: {counts}; {left_out} more rest on nothing that is seen."
    return f"{head}\n\n{counted}\n\n{made_by()}"


def cell(earned: Sequence[Earned]) -> str:
    """The mean reward with its interval."""
    if not earned:
        return "-"
    rewards = np.array([e.reward for e in earned])
    low, high = mean_interval(rewards, [e.scene for e in earned])
    return f"{rewards.mean():.2f} ({low:.2f}-{high:.2f})"


def read_back(options: Namespace) -> None:
    """Print how many narrated sentences hold, by type of question, and the times."""
    scenes = list(islice(read_questions(options.questions), options.videos))
    source = SOURCES[options.source](options.data, {s.scene_index for s in scenes})
    counts: dict[str, Counter[str]] = {}
    seconds: Counter[str] = Counter()
    for asked in scenes:
        scene = source(asked)
        assert isinstance(scene, Scene)
        for question in asked.questions:
            count = counts.setdefault(question.subtype or question.type, Counter())
            try:
                answer = answered(scene, question)
            except NsdrError:
                count["left out"] += 1
                continue
            count["questions"] += 1
            for length in ("short", "long"):
                start = time.process_time()
                text = narrate(answer, scene, length)
                end = time.process_time()
                found = verify(text, scene)
                seconds["narrate"] += end - start
                seconds["verify"] += time.process_time() - end
                count["sentences"] += len(text.splitlines()) - 1
                count["hold"] += sum(c.holds is True for c in found.claims)
    counts = dict(sorted(counts.items())) | {"all": sum(counts.values(), Counter())}
    for kind, count in counts.items():
        print(f"{kind:<16}", ", ".join(f"{name} {n}" for name, n in count.items()))
    texts = max(2 * counts["all"]["questions"], 1)
    print("CPU time a text:", ", ".join(f"{name} {1000 * s / texts:.2f} ms" for name, s in seconds.items()))


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--scenes", type=int, default=110, help="of which about half have a predictive question")
    parser.add_argument("--per-type", type=int, default=50, help="most questions of a type")
    parser.add_argument("-o", "--output", type=Path, help="file of the table")
    parser.add_argument("--questions", type=Path, help="questions whose answers are narrated")
    parser.add_argument("--data", type=Path, help="what the scene source reads")
    parser.add_argument("--source", default="truth", help="scene source, as of `nsdr evaluate`")
    parser.add_argument("--videos", type=int, help="number of videos; all by default")
    options = parser.parse_args()
    if options.questions:
        read_back(options)
        return
    with tempfile.TemporaryDirectory() as folder:
        show(table_of(*measure(options.scenes, options.per_type, Path(folder))), options.output)


if __name__ == "__main__":
    main()
