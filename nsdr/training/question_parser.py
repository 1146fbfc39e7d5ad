"""Train the question parser: `nsdr train question-parser --config configs/question_parser/default.yaml`."""

from collections.abc import Sequence
from dataclasses import replace

from nsdr.training.ablation import parse_sizes, run_ablation
from nsdr.training.question_parser_task import QuestionParserTraining, train_question_parser
from nsdr.training.run_folder import parse_training

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> str:
    """Train from command-line arguments; returns the folder of the finished checkpoint.

    With `--ablation 10,100,all`, train once for each number of programs and return the path of the table instead.
    """
    config = parse_training(QuestionParserTraining, argv, "question-parser")
    if config.ablation:
        return run_ablation(replace(config, ablation=""), parse_sizes(config.ablation))
    return train_question_parser(config)
