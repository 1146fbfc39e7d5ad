"""Scores answers the way the paper does: descriptive accuracy; the other types per option and per question."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from tqdm import tqdm

from nsdr.clevrer.proposals import read_compact_proposals, read_proposals
from nsdr.clevrer.questions import QUESTION_TYPES, Question, SceneQuestions, read_questions
from nsdr.clevrer.scenes import scene_from_ground_truth, scene_from_truth
from nsdr.errors import DataError, ExecutionError, NsdrError, QuestionError
from nsdr.files import read_json
from nsdr.symbolic import Executor, Program
from nsdr.types import Scene

__all__ = ["evaluate", "evaluate_file", "format_table"]

Parse = Callable[[str, str], Program]
"""(text, kind) -> program, as `QuestionParser.parse`."""


def evaluate(scenes: Iterable[tuple[SceneQuestions, Scene | NsdrError]], parse: Parse | None = None) -> dict[str, Any]:
    """Answer and score all questions.

    Args:
        scenes: questions with the scene they are about, or the error that kept it from being made.
        parse: turns texts into programs; None runs the programs of the question file.

    Returns:
        The table by question type as fractions 0-1, and under `results` every question with its answers. What fails
        is counted wrong and carries its `error`.
    """
    results = []
    for questions, scene in scenes:
        executor = Executor(scene) if isinstance(scene, Scene) else None
        for question in questions.questions:
            result: dict[str, Any] = {"scene_index": questions.scene_index, "question_id": question.id}
            result |= {"question_type": question.type, "question_subtype": question.subtype}
            try:
                if executor is None:
                    assert isinstance(scene, NsdrError)
                    raise scene
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
    choices = []
    for choice in question.choices:
        row: dict[str, Any] = {"choice_id": choice.id}
        try:
            choice_program = parse(choice.text, "choice") if parse else _gold(choice.program)
            answer = executor.judge(program, [(choice.text, choice_program)]).choices[0].answer
        except (ExecutionError, QuestionError) as e:
            # The choice names something that is not in the scene: it cannot be right.
            row["error"] = str(e)
            answer = "wrong"
        choices.append(row | {"answer": answer, "correct": answer == choice.answer})
    return {"choices": choices, "correct": all(c["correct"] for c in choices)}


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


def evaluate_file(
    questions: str | Path,
    source: str,
    data: str | Path,
    programs: str = "parsed",
    checkpoint: str | Path = "default",
    exclude: set[int] | None = None,
) -> dict[str, Any]:
    """Score a question file on scenes from a source.

    Args:
        questions: question file.
        source: "videos" (`video_N.mp4`), "proposals" (`proposal_N.json`, `sim_N.json[.gz]`), "compact-proposals" (NPZ),
            "ground-truth" (gzipped list of blocks), or "truth" (`truth_N.json` of our generator).
        data: its folder or file.
        programs: "parsed" or "gold".
        checkpoint: weights, where a network is needed.
        exclude: scene indices to leave out.

    Raises:
        DataError: unreadable questions or data.
    """
    listed = [s for s in read_questions(questions) if s.scene_index not in (exclude or set())]
    parse: Parse | None = None
    if programs == "parsed":
        from nsdr.checkpoint import find_checkpoint
        from nsdr.question_parser.parser import QuestionParser

        parse = QuestionParser.from_checkpoint(find_checkpoint(checkpoint)).parse
    scene_of = _scene_source(source, Path(data), checkpoint, {s.scene_index for s in listed})

    def pairs() -> Iterator[tuple[SceneQuestions, Scene | NsdrError]]:
        for scene_questions in tqdm(listed, desc="scenes", unit="scene"):
            try:
                yield scene_questions, scene_of(scene_questions)
            except NsdrError as e:
                yield scene_questions, e

    return evaluate(pairs(), parse)


def _scene_source(
    source: str, data: Path, checkpoint: str | Path, wanted: set[int]
) -> Callable[[SceneQuestions], Scene]:
    if not data.exists():
        raise DataError(f"{data}: no such file or folder")
    if source == "ground-truth":
        from nsdr.dynamics.data import read_truth

        blocks = read_truth(data)
        return lambda s: scene_from_ground_truth(_of(blocks, s.scene_index, data), blocks[s.scene_index]["n_frames"])
    if source == "truth":
        return lambda s: scene_from_truth(read_json(data / f"truth_{s.scene_index}.json"))
    from nsdr.pipeline import Pipeline

    pipeline = Pipeline.from_pretrained(checkpoint)
    if source == "videos":
        return lambda s: pipeline.perceive(data / s.video_filename)
    if source == "proposals":
        return lambda s: pipeline.perception(proposals=read_proposals(_proposal_file(data, s.scene_index))).scene
    found = {video: p for video, p in read_compact_proposals(data) if video in wanted}
    return lambda s: pipeline.perception(proposals=_of(found, s.scene_index, data)).scene


def _of(table: dict[int, Any], scene_index: int, data: Path) -> Any:
    if scene_index not in table:
        raise DataError(f"{data}: has no scene {scene_index}")
    return table[scene_index]


def _proposal_file(folder: Path, scene_index: int) -> Path:
    names = [f"proposal_{scene_index:05d}.json", f"sim_{scene_index:05d}.json"]
    for path in [folder / (name + ending) for name in names for ending in ("", ".gz")]:
        if path.exists():
            return path
    raise DataError(f"{folder}: has no {' or '.join(names)}")
