"""`nsdr train PART`, whose arguments are fields of a configuration."""

import logging
from importlib import import_module

from nsdr.cli.common import HELP, Command, print_parts
from nsdr.errors import DataError

PARTS = {
    "frame-parser": ("frame_parser", "the detector of objects in frames"),
    "dynamics": ("dynamics", "the paper's network for motion"),
    "collisions": ("collisions", "the network that finds collisions in tracks"),
    "question-parser": ("question_parser", "the networks from texts to programs"),
    "baseline": ("baselines", "a system that answers without programs or without scenes"),
}
"""Of each part the module of `nsdr.training` with its `main(argv)`, and what it is."""


def train(arguments: list[str]) -> int:
    """Train a part from its command-line arguments."""
    if not arguments:
        raise DataError(f"nsdr train: name a part: {', '.join(PARTS)}; nsdr train --help says what they are")
    part, *rest = arguments
    if part in HELP:
        usage = "nsdr train PART [--config NAME|FILE] [--steps N] [--batch-size N] [--lr RATE] [--device cpu|cuda] …"
        more = "nsdr train PART --help shows the options. The same command resumes a run; with more --steps it makes it longer."
        print_parts(usage, PARTS, more)
        return 0
    if part not in PARTS:
        raise DataError(f"nsdr train: expected one of {', '.join(PARTS)}, got {part!r}")
    logging.getLogger("nsdr").setLevel(logging.INFO)
    folder = import_module(f"nsdr.training.{PARTS[part][0]}").main(rest)
    print(folder)
    others = "which take other parts from the shipped weights if those are for the same world"
    use = f'--checkpoint {folder}, or Pipeline.from_pretrained("{folder}"), {others}'
    if part == "baseline":
        use = f'nsdr answer VIDEO "…" --system {folder}'
    print(f"To use these weights: {use}")
    return 0


FUNCTIONS = {
    "train": Command(train),
}
"""What runs the command of this file."""
