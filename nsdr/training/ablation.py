"""What a number of training programs is worth: accuracy of programs and of answers by question type (the paper's figure)."""

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nsdr.clevrer.questions import QUESTION_TYPES, SceneQuestions, read_questions
from nsdr.clevrer.scenes import scene_from_truth
from nsdr.errors import DataError, ProgramError, QuestionError
from nsdr.evaluation.score import evaluate
from nsdr.io.files import atomic_path, read_json
from nsdr.question_parser.parser import QuestionParser
from nsdr.symbolic import Executor, Program

if TYPE_CHECKING:
    from nsdr.training.question_parser import QuestionParserTraining

__all__ = ["ALL", "parse_sizes", "run_ablation"]

ALL = 0
"""As a size: every program that there is."""
COLUMNS = ("programs", "question_type", "questions", "program_accuracy", "answer_accuracy")


def parse_sizes(text: str) -> list[int]:
    """Sizes from text such as "10,50,all".

    Raises:
        DataError: not such a list.
    """
    try:
        sizes = [ALL if part.strip() == "all" else int(part) for part in text.split(",")]
    except ValueError as e:
        raise DataError(f"--ablation {text}: expected numbers of programs, such as 10,100,1000,all") from e
    if any(size < 0 for size in sizes):
        raise DataError(f"--ablation {text}: expected positive numbers")
    return sizes


def run_ablation(
    config: "QuestionParserTraining",
    sizes: Sequence[int],
    train: Callable[["QuestionParserTraining"], str],
) -> str:
    """Train with each number of programs, measure, and write `ablation.csv` and `ablation.png`; returns the CSV's path.

    Args:
        config: the training; its `evaluation_questions` and `evaluation_scenes` are what is measured on.
        sizes: numbers of programs.
        train: trains a configuration and returns the checkpoint's folder. Each size is a run of its own, so an interrupted
            ablation goes on where it stopped.
    """
    if not config.evaluation_questions or not config.evaluation_scenes:
        raise DataError(
            "--ablation needs --evaluation_questions FILE and --evaluation_scenes FOLDER (truth_N.json files)"
        )
    scenes = read_questions(config.evaluation_questions)
    executors = dict(_executors(scenes, Path(config.evaluation_scenes)))
    run_dir = Path(config.run_dir)
    rows: list[dict[str, Any]] = []
    for size in sizes:
        name = "all" if size == ALL else str(size)
        checkpoint = train(replace(config, samples=size, run_dir=str(run_dir / name), output=""))
        parser = QuestionParser.from_checkpoint(checkpoint, min_probability=0.0, unknown="ignore")
        rows += [{"programs": name, **row} for row in _measured(parser, scenes, executors)]
        _write(run_dir / "ablation.csv", rows)
    _image(run_dir / "ablation.png", rows)
    return str(run_dir / "ablation.csv")


def _executors(scenes: Sequence[SceneQuestions], folder: Path) -> Iterator[tuple[int, Executor]]:
    paths = {int("".join(c for c in p.stem if c.isdigit())): p for p in folder.rglob("truth_*.json")}
    for scene in scenes:
        if scene.scene_index not in paths:
            raise DataError(f"{folder}: has no truth_{scene.scene_index:05d}.json")
        yield scene.scene_index, Executor(scene_from_truth(read_json(paths[scene.scene_index])))


def _measured(
    parser: QuestionParser, scenes: Sequence[SceneQuestions], executors: dict[int, Executor]
) -> Iterator[dict[str, Any]]:
    found: dict[tuple[str, str], list[str]] = {}
    for kind, texts in _texts(scenes).items():
        found |= {(text, kind): tokens for text, (tokens, _) in zip(texts, parser.candidates(texts, kind), strict=True)}

    def parse(text: str, kind: str) -> Program:
        try:
            return Program.parse(found[text, kind])
        except ProgramError as e:
            raise QuestionError(str(e)) from e

    report = evaluate(((scene, executors[scene.scene_index]) for scene in scenes), parse)
    for type_ in QUESTION_TYPES:
        questions = [q for scene in scenes for q in scene.questions if q.type == type_]
        if not questions:
            continue
        exact = []
        for q in questions:
            kind = "multiple_choice" if q.choices else "descriptive"
            right = tuple(found[q.text, kind]) == q.program
            exact.append(right and all(tuple(found[c.text, "choice"]) == c.program for c in q.choices))
        answers = report[type_]["accuracy" if type_ == "descriptive" else "per_question"]
        yield {
            "question_type": type_,
            "questions": len(questions),
            "program_accuracy": round(sum(exact) / len(exact), 4),
            "answer_accuracy": round(answers, 4),
        }


def _texts(scenes: Sequence[SceneQuestions]) -> dict[str, list[str]]:
    texts: dict[str, dict[str, None]] = {"descriptive": {}, "multiple_choice": {}, "choice": {}}
    for q in (q for scene in scenes for q in scene.questions):
        texts["multiple_choice" if q.choices else "descriptive"][q.text] = None
        texts["choice"].update(dict.fromkeys(c.text for c in q.choices))
    return {kind: list(found) for kind, found in texts.items() if found}


def _write(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with atomic_path(path) as temporary:
        temporary.write_text(text.getvalue())


def _image(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    sizes = list(dict.fromkeys(row["programs"] for row in rows))
    for position, (column, title) in enumerate(
        (("program_accuracy", "exact programs"), ("answer_accuracy", "right answers"))
    ):
        axes: Any = figure.add_subplot(1, 2, position + 1)
        for type_ in QUESTION_TYPES:
            values = {row["programs"]: 100 * row[column] for row in rows if row["question_type"] == type_}
            if values:
                axes.plot([sizes.index(s) for s in values], list(values.values()), marker="o", label=type_)
        axes.set_xticks(range(len(sizes)), sizes)
        axes.set_xlabel("training programs")
        axes.set_ylabel("%")
        axes.set_title(title, fontsize=10)
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=110)
