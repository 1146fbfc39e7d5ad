"""`nsdr evaluate` and `nsdr experiment`: scores and tables."""

from dataclasses import fields
from typing import Any

from nsdr.clevrer.files.questions import QUESTION_TYPES
from nsdr.cli.common import failures_line, shared_options
from nsdr.io.files import check_output, check_output_folder

__all__ = ["evaluate", "experiment"]


def evaluate_options(parser: Any) -> None:
    from nsdr.evaluation import EvaluationConfig

    add = parser.add_argument
    add("--types", nargs="+", default=list(QUESTION_TYPES), help="question types")
    add("--exclude", type=list[int], default=[], help="scene indices to leave out")
    add("--set", action="append", default=[], help="one setting, such as tracker.score=0.8; repeatable")
    add("-o", "--output", default=None, help="write the table and every result as JSON")
    add("--submission", default=None, help="write the answers as an EvalAI submission")
    shared_options(parser, "parser", "failures")
    explicit = {"types", "exclude", "set", "parser", "parser_model"}
    parser.add_class_arguments(EvaluationConfig, as_group=False, skip=explicit)


def evaluate(options: Any) -> int:
    """`nsdr evaluate`: score answers to a question file or a whole split."""
    from nsdr.clevrer.files.submissions import write_submission
    from nsdr.evaluation import EvaluationConfig, format_table, run_evaluation
    from nsdr.evaluation.score import first_failure
    from nsdr.io.files import write_json

    names = {f.name for f in fields(EvaluationConfig)}
    config = EvaluationConfig(**{k: v for k, v in vars(options).items() if k in names})
    inputs = [
        path for path in (config.questions, config.data, config.videos, config.truth, *config.program_files()) if path
    ]
    if options.output is not None:
        check_output(options.output, [".json"], inputs)
    if options.submission is not None:
        check_output(options.submission, [".json"], [*inputs, *([options.output] if options.output else [])])
    check_output_folder(config.cache)
    report = run_evaluation(config)
    print(format_table(report))
    if report["unlabelled"] and not (options.output or options.submission):
        print("nothing was written: --submission or --output names a file for the answers")
    if options.output:
        write_json(options.output, report, indent=1)
    failed, total = report["errors"], len(report["results"])
    if options.submission and (not failed or options.keep_going):
        write_submission(options.submission, report["results"])
    elif options.submission:
        print(f"{options.submission}: not written, because of the failures; --keep-going writes it")
    return failures_line(failed, total, "questions", first_failure(report), options.keep_going)


def experiment_options(parser: Any) -> None:
    add = parser.add_argument
    add("file", help="configs/experiments/….yaml")
    add("--device", default="auto", help="where networks run: auto, cpu, cuda or cuda:N")
    add("-o", "--output", default="results", help="folder for NAME.json and NAME.md")
    shared_options(parser, "failures")


def experiment(options: Any) -> int:
    """`nsdr experiment`: measure all rows of a table."""
    from nsdr.evaluation import run_experiment
    from nsdr.evaluation.experiments import failed_questions
    from nsdr.training.baselines import BaselineTrainer

    check_output_folder(options.output)
    table = run_experiment(options.file, options.output, options.device, BaselineTrainer())
    print(table.read_text())
    failed, total, example = failed_questions(table)
    return failures_line(failed, total, "questions", example, options.keep_going)
