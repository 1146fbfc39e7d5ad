"""`nsdr train frame-parser|dynamics|collisions|question-parser|backbone|baseline|average`."""

import logging
import re
from importlib import import_module

from nsdr.errors import DataError

__all__ = ["PARTS", "train"]

PARTS = {
    name: f"nsdr.training.{name.replace('-', '_')}"
    for name in ("frame-parser", "dynamics", "collisions", "question-parser", "backbone", "average")
} | {"baseline": "nsdr.training.baselines"}
"""Module with the `main(argv)` of each part, and of the mean of several runs."""


def train(arguments: list[str]) -> int:
    """Train a part from its command-line arguments; `--device` stands for `--loop.device`."""
    if not arguments or arguments[0] not in PARTS:
        found = arguments[0] if arguments else "nothing"
        raise DataError(f"nsdr train: expected one of {', '.join(PARTS)}, got {found!r}")
    logging.getLogger("nsdr").setLevel(logging.INFO)
    options = [re.sub(r"^--device(?==|$)", "--loop.device", argument) for argument in arguments[1:]]
    print(import_module(PARTS[arguments[0]]).main(options))
    return 0
