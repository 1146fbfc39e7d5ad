"""Ablation of the number of training programs, with the networks alone: programs and answers by question type (figure)."""

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from nsdr.clevrer.files.questions import QUESTION_TYPES, Question, SceneQuestions, read_questions
from nsdr.errors import DataError, NsdrError, ProgramError, QuestionError
from nsdr.evaluation.runner import parse_all, true_scene_of
from nsdr.evaluation.score import Parse, evaluate
from nsdr.evaluation.sources import SOURCES
from nsdr.io.files import atomic_path, locked
from nsdr.question_parser.base import Parser
from nsdr.question_parser.network import QuestionParser
from nsdr.symbolic import Executor, Program

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


def run_ablation(train: Callable[[int, str], str], sizes: str, run_dir: str, questions: str, truth: str) -> str:
    """Train with each number of programs, evaluate, and write `ablation.csv` to the run's folder.

    Each size is a run of its own in a subfolder, so an interrupted ablation is resumed where it stopped.

    Args:
        train: trains with so many programs in a run folder, and returns the folder of the checkpoint.
        sizes: numbers of programs, as in `parse_sizes`.
        run_dir: folder of the ablation.
        questions: question file with programs and answers, to evaluate on.
        truth: folder with `truth_N.json` of its scenes.

    Returns:
        The path of the CSV file.

    Raises:
        DataError: a missing or unreadable file, or another process writes to the folder.
    """
    numbers = parse_sizes(sizes)
    scenes = read_questions(questions)
    source = SOURCES["truth"](Path(truth), {s.scene_index for s in scenes})
    executors = [Executor(true_scene_of(source, s)) for s in scenes]
    table = Path(run_dir) / "ablation.csv"
    with locked(run_dir):
        rows: list[dict[str, Any]] = []
        for size in numbers:
            name = "all" if size == ALL else str(size)
            parser = _MostProbable(QuestionParser.from_checkpoint(train(size, f"{run_dir}/{name}")))
            parse = parse_all(parser, scenes, QUESTION_TYPES)
            report = evaluate(zip(scenes, executors, strict=True), parse)
            rows += [{"programs": name, **row} for row in _accuracies(scenes, parse, report)]
            with atomic_path(table) as temporary, temporary.open("w", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows)
    return str(table)


class _MostProbable(Parser):
    """The networks' most probable program of each text, however improbable it is."""

    def __init__(self, networks: QuestionParser) -> None:
        self.networks = networks

    def parse_batch(self, texts: Sequence[str], kind: str = "descriptive") -> list[Program | NsdrError]:
        found: list[Program | NsdrError] = []
        for tokens, _ in self.networks.candidates(texts, kind):
            try:
                found.append(Program.parse(tokens))
            except ProgramError as e:
                found.append(QuestionError(str(e)))
        return found


def _accuracies(scenes: Sequence[SceneQuestions], parse: Parse, report: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """One row of the table for each question type that occurs; a question's choices count with it."""
    for question_type in QUESTION_TYPES:
        exact = [_is_exact(q, parse) for scene in scenes for q in scene.questions if q.type == question_type]
        if exact:
            answer_accuracy = report[question_type]["accuracy" if question_type == "descriptive" else "per_question"]
            yield {
                "question_type": question_type,
                "questions": len(exact),
                "program_accuracy": round(sum(exact) / len(exact), DECIMALS),
                "answer_accuracy": round(answer_accuracy, DECIMALS),
            }


def _is_exact(question: Question, parse: Parse) -> bool:
    """Whether the programs of a question and of its choices are those of the file."""
    kind = "multiple_choice" if question.choices else "descriptive"
    texts = [(question.text, kind, question.program), *((c.text, "choice", c.program) for c in question.choices)]
    try:
        return all(parse(text, kind).tokens == program for text, kind, program in texts)
    except QuestionError:
        return False
