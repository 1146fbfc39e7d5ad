"""What a command is doing, on a terminal, while nothing else is to be seen."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm


@contextmanager
def stage(name: str, shown: bool) -> Iterator[None]:
    """Show a line on stderr, such as "loading the networks …", until the block ends.

    Args:
        name: what is done.
        shown: whether it is shown at all.
    """
    with tqdm(desc=name, bar_format="{desc} …", leave=False, disable=not shown, file=sys.stderr):
        yield
