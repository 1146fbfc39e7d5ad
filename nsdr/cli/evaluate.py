"""`nsdr evaluate` and `nsdr experiment`: scores and tables."""

from dataclasses import fields
from typing import Any

__all__ = ["evaluate", "experiment"]


def evaluate(options: Any) -> int:
    """`nsdr evaluate`: score answers to a question file or a whole split."""
    from nsdr.clevrer.submissions import write_submission
    from nsdr.evaluation import EvaluationConfig, format_table, run_evaluation
    from nsdr.io.files import write_json

    names = {f.name for f in fields(EvaluationConfig)}
    report = run_evaluation(EvaluationConfig(**{k: v for k, v in vars(options).items() if k in names}))
    print(format_table(report))
    if report["unlabelled"] and not (options.output or options.submission):
        print("nothing was written: --submission or --output names a file for the answers")
    if options.output:
        write_json(options.output, report, indent=1)
    if options.submission:
        write_submission(options.submission, report["results"])
    return 0


def experiment(options: Any) -> int:
    """`nsdr experiment`: measure all rows of a table."""
    from nsdr.evaluation import run_experiment

    print(run_experiment(options.file, options.output, options.device).read_text())
    return 0
