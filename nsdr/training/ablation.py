"""Ablation of the number of training programs, with the networks alone: programs and answers by question type (figure)."""

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.annotations import read_truth_file
from nsdr.clevrer.files.questions import QUESTION_TYPES, SceneQuestions, read_questions
from nsdr.clevrer.files.scenes import scene_from_truth
from nsdr.errors import DataError, ProgramError, QuestionError
from nsdr.evaluation.score import evaluate
from nsdr.io.files import atomic_path, find_files, locked
from nsdr.language.texts import TEXT_KINDS
from nsdr.question_parser.network import QuestionParser
from nsdr.symbolic import Executor, Program
from nsdr.training.question_parser_task import QuestionParserTraining, train_question_parser

__all__ = ["ALL", "parse_sizes", "run_ablation"]

ALL = 0
"""The size that stands for all programs, as in `QuestionParserTraining.samples`."""
COLUMNS = ("programs", "question_type", "questions", "program_accuracy", "answer_accuracy")
"""Columns of `ablation.csv`; accuracies are fractions 0-1."""
DECIMALS = 4
"""Decimals of the accuracies in `ablation.csv`."""


def parse_sizes(text: str) -> list[int]:
    """Numbers of programs from text such as "10,50,all", where "all" is `ALL`.

    Raises:
        DataError: the text is not such a list.
    """
    try:
        sizes = [ALL if part.strip() == "all" else int(part) for part in text.split(",")]
    except ValueError as e:
        raise DataError(f"--ablation {text}: expected numbers of programs, such as 10,100,1000,all") from e
    if any(size < 0 for size in sizes):
        raise DataError(f"--ablation {text}: expected positive numbers")
    return sizes


def run_ablation(config: QuestionParserTraining, sizes: Sequence[int]) -> str:
    """Train with each number of programs, evaluate, and write `ablation.csv` to the run's folder (`nsdr figures` draws it).

    Each size is a run of its own in a subfolder, so an interrupted ablation is resumed where it stopped.

    Args:
        config: the training, with `evaluation_questions` and `evaluation_scenes` to evaluate on.
        sizes: numbers of programs, as `parse_sizes` gives them.

    Returns:
        The path of the CSV file.

    Raises:
        DataError: no questions or scenes to evaluate on, a missing or unreadable file, or another process writes to the folder.
    """
    if not config.evaluation_questions or not config.evaluation_scenes:
        raise DataError(
            "--ablation needs --evaluation_questions FILE and --evaluation_scenes FOLDER (truth_N.json files)"
        )
    scenes = read_questions(config.evaluation_questions)
    executors = dict(_executors(scenes, Path(config.evaluation_scenes)))
    run_dir = Path(config.run_dir)
    with locked(run_dir):
        rows: list[dict[str, Any]] = []
        for size in sizes:
            name = "all" if size == ALL else str(size)
            size_config = replace(config, samples=size, run_dir=str(run_dir / name), output="")
            checkpoint = train_question_parser(size_config)
            parser = QuestionParser.from_checkpoint(checkpoint)
            rows += [{"programs": name, **row} for row in _accuracies(parser, scenes, executors)]
            _write_csv(run_dir / "ablation.csv", rows)
    return str(run_dir / "ablation.csv")


def _executors(scenes: Sequence[SceneQuestions], folder: Path) -> Iterator[tuple[int, Executor]]:
    """Scene index and executor on the true scene, for every scene of the question file."""
    paths = {int("".join(c for c in p.stem if c.isdigit())): p for p in find_files(folder, "truth_*.json")}
    for scene in scenes:
        if scene.scene_index not in paths:
            raise DataError(f"{folder}: has no truth_{scene.scene_index:05d}.json")
        yield scene.scene_index, Executor(scene_from_truth(read_truth_file(paths[scene.scene_index])))


def _accuracies(
    parser: QuestionParser, scenes: Sequence[SceneQuestions], executors: dict[int, Executor]
) -> Iterator[dict[str, Any]]:
    """One row of the table for each question type that occurs; a question's choices count with it."""
    parsed: dict[tuple[str, str], list[str]] = {}
    for kind, texts in _texts(scenes).items():
        candidates = parser.candidates(texts, kind)
        parsed |= {(text, kind): tokens for text, (tokens, _) in zip(texts, candidates, strict=True)}

    def parse(text: str, kind: str) -> Program:
        try:
            return Program.parse(parsed[text, kind])
        except ProgramError as e:
            raise QuestionError(str(e)) from e

    report = evaluate(((scene, executors[scene.scene_index]) for scene in scenes), parse)
    for question_type in QUESTION_TYPES:
        questions = [q for scene in scenes for q in scene.questions if q.type == question_type]
        if not questions:
            continue
        exact = []
        for q in questions:
            kind = "multiple_choice" if q.choices else "descriptive"
            is_exact = tuple(parsed[q.text, kind]) == q.program
            exact.append(is_exact and all(tuple(parsed[c.text, "choice"]) == c.program for c in q.choices))
        answer_accuracy = report[question_type]["accuracy" if question_type == "descriptive" else "per_question"]
        yield {
            "question_type": question_type,
            "questions": len(questions),
            "program_accuracy": round(sum(exact) / len(exact), DECIMALS),
            "answer_accuracy": round(answer_accuracy, DECIMALS),
        }


def _texts(scenes: Sequence[SceneQuestions]) -> dict[str, list[str]]:
    """The distinct texts of each kind that occurs."""
    texts: dict[str, dict[str, None]] = {kind: {} for kind in TEXT_KINDS}
    for q in (q for scene in scenes for q in scene.questions):
        texts["multiple_choice" if q.choices else "descriptive"][q.text] = None
        texts["choice"].update(dict.fromkeys(c.text for c in q.choices))
    return {kind: list(distinct) for kind, distinct in texts.items() if distinct}


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with atomic_path(path) as temporary:
        temporary.write_text(text.getvalue())
