"""`nsdr score`, `nsdr dummy` and `nsdr controls`: one protocol for any system's answers."""

from pathlib import Path
from typing import Any

from jsonargparse.typing import NonNegativeInt, NotEmptyStr

from nsdr.errors import DataError
from nsdr.io.files import check_output, check_output_folder

__all__ = ["add_options", "controls", "dummy", "score"]


def add_options(commands: Any, splits: list[str], engines: list[str]) -> None:
    """Add the three commands.

    Args:
        commands: `add(name, summary, …)` adds one.
        splits: names of the splits.
        engines: names of the engines.
    """
    add = commands.add("score", "score a file of answers, or compare two", checkpoint=False).add_argument
    add("predictions", help="JSON Lines, CSV, or an EvalAI submission")
    add("other", nargs="?", default=None, help="a second system's file, to be compared with the first")
    add("--questions", type=NotEmptyStr, required=True, help="question file with answers, in CLEVRER's format")
    add("--allow-missing", action="store_true", help="leave out questions without an answer; else they count as wrong")
    add("-o", "--output", default=None, help="write the report as JSON")

    add = commands.add("dummy", "write the answers of a system that understands nothing", checkpoint=False).add_argument
    add("name", choices=["always-yes", "always-no", "keep-recording"], help="which system")
    add("--questions", type=NotEmptyStr, required=True, help="question file in CLEVRER's format")
    add("--source", default="", help="keep-recording: what the true scenes are made from, such as truth")
    add("--data", default="", help="keep-recording: folder of these files")
    add("-o", "--output", required=True, help="JSON Lines file to write")

    summary = "write blind, reversed and shuffled videos of a data set, as controls; resumable"
    add = commands.add("controls", summary, checkpoint=False).add_argument
    add("root", help="data set in the official layout")
    add("--split", default="validation", choices=splits, help="which videos")
    add("--kinds", nargs="+", default=["blind", "reversed", "shuffled"], help="which controls")
    add("--seed", type=NonNegativeInt, default=0, help="shuffled: which exchange of videos")
    add("--limit", type=NonNegativeInt, default=0, help="the first n videos and their questions; 0 for all")
    add("-o", "--output", required=True, help="folder, with one data set for each kind")
    add("--workers", type=NonNegativeInt, default=0, help="number of processes; 0 for one per CPU core")
    add("--engine", default="processes", choices=engines, help="where to work")
    add("--keep-going", action="store_true", help="exit with status 0 although a part of the work failed")


def score(options: Any) -> int:
    """`nsdr score`: the table of one system, or the difference of two."""
    from nsdr.clevrer.answers.answer_files import read_answers
    from nsdr.clevrer.files.questions import read_questions
    from nsdr.evaluation.comparison import compare_reports, format_comparison
    from nsdr.evaluation.responses import format_report, score_responses
    from nsdr.io.files import write_json

    files = [options.predictions] if options.other is None else [options.predictions, options.other]
    if options.output is not None:
        check_output(options.output, [".json"], [options.questions, *files])
    questions = read_questions(options.questions)
    reports = []
    for file in files:
        answers = read_answers(file)
        try:
            reports.append(score_responses(questions, answers, options.allow_missing))
        except DataError as e:
            raise DataError(f"{file} with {options.questions}: {e}") from e
        new = not any(reports[-1]["references"] == r["references"] for r in reports[:-1])
        print(f"{file}:\n{format_report(reports[-1], new)}\n")
    document: dict[str, Any] = reports[0]
    if len(reports) == 2:
        comparison = compare_reports(*reports)
        print(format_comparison(comparison, *map(str, files)))
        document = {"files": files, "reports": reports, "comparison": comparison}
    if options.output is not None:
        write_json(options.output, document, indent=1)
    return 0


def dummy(options: Any) -> int:
    """`nsdr dummy`: the answers of a system that understands nothing."""
    from nsdr.clevrer.files.questions import read_questions
    from nsdr.evaluation.dummies import write_dummy

    check_output(options.output, [".jsonl"], [options.questions])
    scenes = read_questions(options.questions)
    empty = write_dummy(options.name, scenes, options.output, options.source, options.data)
    print(f"{options.output}: {sum(len(s.questions) for s in scenes)} responses, {empty} of them empty")
    return 0


def controls(options: Any) -> int:
    """`nsdr controls`: a data set of other videos for each kind of control."""
    from nsdr.cli.status import failures_line
    from nsdr.evaluation.controls import write_controls

    check_output_folder(options.output)
    failed: dict[str, str] = {}
    total = 0
    for kind, summary in write_controls(
        options.root,
        options.output,
        options.split,
        options.kinds,
        options.seed,
        options.limit,
        options.workers,
        options.engine,
    ).items():
        print(f"{Path(options.output) / kind}: {len(summary.done)} videos written, {len(summary.skipped)} kept")
        failed |= {f"{kind} {name}": message for name, message in summary.failed.items()}
        total += len(summary.done) + len(summary.skipped) + len(summary.failed)
    example = ": ".join(min(failed.items())) if failed else ""
    return failures_line(len(failed), total, "videos", example, options.keep_going)
