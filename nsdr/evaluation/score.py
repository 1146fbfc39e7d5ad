"""Scores answers the way the paper does: descriptive accuracy; the other types per option and per question."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence, Set
from pathlib import Path
from typing import Any

from tqdm import tqdm

from nsdr.clevrer.annotations import read_annotation
from nsdr.clevrer.predictions import read_predictions, scene_from_predictions
from nsdr.clevrer.proposals import read_compact_proposals, read_ground_truth, read_proposals
from nsdr.clevrer.questions import QUESTION_TYPES, Choice, Question, SceneQuestions, read_questions
from nsdr.clevrer.scenes import scene_from_annotation, scene_from_ground_truth, scene_from_truth
from nsdr.errors import DataError, ExecutionError, NsdrError, QuestionError
from nsdr.io import storage
from nsdr.io.files import read_json
from nsdr.symbolic import Executor, Program
from nsdr.tracking.truth_tracks import tracks_from_annotation
from nsdr.types import Scene

__all__ = ["SOURCES", "evaluate", "evaluate_file", "format_table"]

Parse = Callable[[str, str], Program]
"""(text, kind) -> program, as `QuestionParser.parse`."""


def evaluate(
    scenes: Iterable[tuple[SceneQuestions, Executor | NsdrError]],
    parse: Parse | None = None,
    types: Sequence[str] = QUESTION_TYPES,
) -> dict[str, Any]:
    """Answer and score all questions.

    Args:
        scenes: questions with the executor of the scene they are about, or the error that kept it from being made.
        parse: turns texts into programs; None runs the programs of the question file.
        types: question types to answer.

    Returns:
        The table by question type as fractions 0-1, and under `results` every question with its answers. What fails
        is counted wrong and carries its `error`.
    """
    results = []
    for questions, executor in scenes:
        for question in questions.questions:
            if question.type not in types:
                continue
            result: dict[str, Any] = {"scene_index": questions.scene_index, "question_id": question.id}
            result |= {"question_type": question.type, "question_subtype": question.subtype}
            try:
                if isinstance(executor, NsdrError):
                    raise executor
                result |= _answered(executor, question, parse)
            except NsdrError as e:
                result |= {"correct": False, "error": str(e)}
                if question.choices:
                    result["choices"] = [
                        {"choice_id": c.id, "answer": "wrong", "correct": False} for c in question.choices
                    ]
            results.append(result)
    return {**_table(results), "errors": sum("error" in r for r in results), "results": results}


def _answered(executor: Executor, question: Question, parse: Parse | None) -> dict[str, Any]:
    if question.type == "descriptive":
        program = parse(question.text, "descriptive") if parse else _gold(question.program)
        answer = executor.answer(program).answer
        return {"answer": answer, "correct": answer == question.answer}
    program = parse(question.text, "multiple_choice") if parse else _gold(question.program)
    try:
        programs = [(c.text, parse(c.text, "choice") if parse else _gold(c.program)) for c in question.choices]
        answers: list[Any] = [c.answer for c in executor.judge(program, programs).choices]
    except (ExecutionError, QuestionError):
        answers = [_judged_alone(executor, program, choice, parse) for choice in question.choices]
    choices = []
    for choice, answer in zip(question.choices, answers, strict=True):
        row: dict[str, Any] = {"choice_id": choice.id}
        if isinstance(answer, NsdrError):
            # The choice names something that is not in the scene: it cannot be right.
            row["error"] = str(answer)
            answer = "wrong"
        choices.append(row | {"answer": answer, "correct": answer == choice.answer})
    return {"choices": choices, "correct": all(c["correct"] for c in choices)}


def _judged_alone(executor: Executor, program: Program, choice: Choice, parse: Parse | None) -> str | NsdrError:
    try:
        choice_program = parse(choice.text, "choice") if parse else _gold(choice.program)
        return executor.judge(program, [(choice.text, choice_program)]).choices[0].answer
    except (ExecutionError, QuestionError) as e:
        return e


def _gold(program: tuple[str, ...] | None) -> Program:
    if program is None:
        raise QuestionError("the question file has no programs; use parsed ones")
    return Program.parse(program)


def _table(results: list[dict[str, Any]]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for kind in QUESTION_TYPES:
        rows = [r for r in results if r["question_type"] == kind]
        if kind == "descriptive":
            subtypes = {}
            for name in sorted({str(r["question_subtype"]) for r in rows}):
                of_type = [r for r in rows if str(r["question_subtype"]) == name]
                subtypes[name] = {"accuracy": _share(of_type), "n": len(of_type)}
            table[kind] = {"accuracy": _share(rows), "n": len(rows), "subtypes": subtypes}
        else:
            options = [c for r in rows for c in r["choices"]]
            table[kind] = {"per_option": _share(options), "per_question": _share(rows)}
            table[kind] |= {"n_options": len(options), "n_questions": len(rows)}
    return table


def _share(rows: list[dict[str, Any]]) -> float | None:
    return sum(r["correct"] for r in rows) / len(rows) if rows else None


def format_table(report: dict[str, Any]) -> str:
    """The report as the paper's table, percentages, with the number of questions."""

    def percent(value: float | None) -> str:
        return "     -" if value is None else f"{100 * value:6.1f}"

    lines = [f"{'':<22}{'per option':>12}{'per question':>14}{'questions':>11}"]
    for kind in QUESTION_TYPES:
        row = report[kind]
        if kind == "descriptive":
            lines.append(f"{kind:<22}{'':>12}{percent(row['accuracy']):>14}{row['n']:>11}")
            for name, part in row["subtypes"].items():
                lines.append(f"  {name:<20}{'':>12}{percent(part['accuracy']):>14}{part['n']:>11}")
        else:
            option, question = percent(row["per_option"]), percent(row["per_question"])
            lines.append(f"{kind:<22}{option:>12}{question:>14}{row['n_questions']:>11}")
    if report["errors"]:
        lines.append(f"{report['errors']} questions failed and count as wrong:")
        reasons = Counter(_reason(r["error"]) for r in report["results"] if "error" in r)
        lines += [f"  {count:>5}  {reason}" for reason, count in reasons.most_common(5)]
    return "\n".join(lines)


def _reason(error: str) -> str:
    """An execution error without its inputs, so that alike ones can be counted together."""
    head, _, tail = error.partition("(")
    return f"{head.split(' ')[-1]}: {tail.rsplit('): ', 1)[-1]}" if "): " in tail else error[:100]


SOURCES = ("videos", "proposals", "tracks", "predictions", "annotations", "ground-truth", "truth", "scenes")
_FILE_NAMES = {
    "proposals": ("proposal_{:05d}.json", "sim_{:05d}.json", "proposal_{:05d}.json.gz", "sim_{:05d}.json.gz"),
    "predictions": ("sim_{:05d}.json",),
    "annotations": ("annotation_{:05d}.json",),
    "tracks": ("annotation_{:05d}.json",),
    "ground-truth": ("sim_{:05d}.json", "sim_{:05d}.json.gz"),
    "truth": ("truth_{:05d}.json",),
    "scenes": ("scene_{:05d}.json",),
}


def evaluate_file(
    questions: str | Path,
    source: str,
    data: str | Path,
    programs: str = "parsed",
    checkpoint: str | Path = "default",
    types: Sequence[str] = QUESTION_TYPES,
    semantics: str = "paper",
    collisions: str = "predicted",
    exclude: Set[int] = frozenset(),
    dynamics: str | Path = "physics",
    truth: tuple[str, str | Path] | None = None,
    made: MutableMapping[Any, Scene] | None = None,
    every: int = 1,
) -> dict[str, Any]:
    """Score a question file on scenes from a source.

    Args:
        questions: question file.
        source: what scenes are made from: "videos" (`video_N.mp4`), "proposals" (`proposal_N.json`, `sim_N.json`),
            "predictions" (`sim_N.json` of the dynamics predictor), "annotations", "ground-truth" (the truth block of
            `processed_proposals` files), or "truth" (our generator's `truth_N.json`); "tracks" takes the motion of
            annotations as if it had been tracked, "scenes" files saved by `nsdr parse-videos`.
        data: their folder; for "proposals" also a compact NPZ, for "ground-truth" also a gzipped list of blocks.
        programs: "parsed" or "gold".
        checkpoint: weights, where a network is needed.
        types: question types to answer.
        semantics: "paper" or "official"; the latter needs predictions.
        collisions: for the official semantics "predicted", or "velocity" (NE).
        exclude: scene indices to leave out.
        dynamics: backend of the dynamics predictor, or its YAML file.
        made: scenes made before, to which new ones are added.
        every: takes every so-manieth scene of those with such questions.
        truth: (source, data) of scenes whose observed collisions take the position of predicted ones.

    Raises:
        DataError: unreadable questions or data, or values that do not go together.
    """
    data = Path(data)
    if not data.exists():
        raise DataError(f"{data}: no such file or folder")
    if semantics == "official" and source != "predictions":
        raise DataError(f"the official semantics runs on predictions, not on {source}; use --source predictions")
    unknown = sorted(set(types) - set(QUESTION_TYPES))
    if unknown:
        raise DataError(f"unknown question type {unknown[0]!r}; expected {', '.join(QUESTION_TYPES)}")
    listed = [s for s in read_questions(questions) if s.scene_index not in exclude]
    listed = [s for s in listed if any(q.type in types for q in s.questions)][::every]
    parse: Parse | None = None
    if programs == "parsed":
        from nsdr.io.checkpoint import find_checkpoint
        from nsdr.question_parser.parser import QuestionParser

        parse = QuestionParser.from_checkpoint(find_checkpoint(checkpoint)).parse
    if semantics == "official":

        def executor_of(s: SceneQuestions) -> Executor:
            document = read_predictions(_file(data, source, s.scene_index))
            return Executor(document, "official", collisions)
    else:
        wanted = {s.scene_index for s in listed}
        true_of = None if truth is None else _scene_source(truth[0], Path(truth[1]), checkpoint, dynamics, wanted)
        scene_of = _scene_source(source, data, checkpoint, dynamics, wanted, true_of)

        recipe = (source, str(data), str(checkpoint), str(dynamics), truth)
        made = {} if made is None else made

        def executor_of(s: SceneQuestions) -> Executor:
            key = (*recipe, s.scene_index)
            if key not in made:
                made[key] = scene_of(s)
            return Executor(made[key])

    def pairs() -> Iterator[tuple[SceneQuestions, Executor | NsdrError]]:
        for scene_questions in tqdm(listed, desc="scenes", unit="scene"):
            try:
                yield scene_questions, executor_of(scene_questions)
            except NsdrError as e:
                yield scene_questions, e

    return evaluate(pairs(), parse, types)


def _scene_source(
    source: str,
    data: Path,
    checkpoint: str | Path,
    dynamics: str | Path,
    wanted: Set[int],
    true_of: Callable[[SceneQuestions], Scene] | None = None,
) -> Callable[[SceneQuestions], Scene]:
    """How scenes are made from a source."""
    if source == "ground-truth" and data.is_file():
        from nsdr.clevrer.truth_blocks import read_truth

        blocks = read_truth(data)
        return lambda s: scene_from_ground_truth(_of(blocks, s.scene_index, data), blocks[s.scene_index]["n_frames"])
    if source == "ground-truth":
        return lambda s: scene_from_ground_truth(*read_ground_truth(_file(data, source, s.scene_index)))
    if source == "annotations":
        return lambda s: scene_from_annotation(read_annotation(_file(data, source, s.scene_index)))
    if source == "predictions":
        return lambda s: scene_from_predictions(read_predictions(_file(data, source, s.scene_index)))
    if source == "truth":
        return lambda s: scene_from_truth(read_json(_file(data, source, s.scene_index)))
    if source == "scenes":
        return lambda s: storage.load(Scene, _file(data, source, s.scene_index))
    if source not in SOURCES:
        raise DataError(f"source is {source!r}; expected one of {', '.join(SOURCES)}")
    from nsdr.pipeline import Pipeline

    pipeline = Pipeline.from_pretrained(checkpoint, dynamics)
    given: Callable[[SceneQuestions], dict[str, Any]]
    if source == "videos":

        def given(s: SceneQuestions) -> dict[str, Any]:
            return {"video": _video(data, s)}
    elif source == "tracks":

        def given(s: SceneQuestions) -> dict[str, Any]:
            return {"tracks": tracks_from_annotation(read_annotation(_file(data, source, s.scene_index)))}
    elif data.is_dir():

        def given(s: SceneQuestions) -> dict[str, Any]:
            return {"proposals": read_proposals(_file(data, source, s.scene_index))}
    else:
        found = {video: p for video, p in read_compact_proposals(data) if video in wanted}

        def given(s: SceneQuestions) -> dict[str, Any]:
            return {"proposals": _of(found, s.scene_index, data)}

    return lambda s: pipeline.perceive(**given(s), true_scene=true_of(s) if true_of else None).scene


def _of(table: Mapping[int, Any], scene_index: int, data: Path) -> Any:
    if scene_index not in table:
        raise DataError(f"{data}: has no scene {scene_index}")
    return table[scene_index]


def _video(folder: Path, s: SceneQuestions) -> Path:
    """A scene's video, in the folder itself or the official sub-folders of 1,000."""
    thousand = s.scene_index // 1000 * 1000
    inside = folder / f"video_{thousand:05d}-{thousand + 1000:05d}" / s.video_filename
    return inside if inside.exists() else folder / s.video_filename


def _file(folder: Path, source: str, scene_index: int) -> Path:
    """The file of a scene, in the folder itself or the official sub-folders of 1,000."""
    thousand = scene_index // 1000 * 1000
    names = [name.format(scene_index) for name in _FILE_NAMES[source]]
    for name in names:
        stem = name.split("_")[0]
        for path in (folder / name, folder / f"{stem}_{thousand:05d}-{thousand + 1000:05d}" / name):
            if path.exists():
                return path
    raise DataError(f"{folder}: has no {' or '.join(names)}")
