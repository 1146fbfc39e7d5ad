"""The command `nsdr`: one file per group of commands. Nothing imports this room."""

import os
import sys

__all__ = ["run"]

INTERRUPTED = 130
"""Exit status after Ctrl-C."""


def run() -> int:
    """The program `nsdr`; Ctrl-C while it is still being loaded is one line, too.

    After a signal it ends at once: taking down Python and its libraries takes seconds.
    """
    try:
        from nsdr.io.device import passive_environment

        os.environ.update(passive_environment())  # of this program and its workers
        from nsdr.cli.main import main

        status = main()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        status = INTERRUPTED
    if status >= INTERRUPTED:
        sys.stderr.flush()
        os._exit(status)
    return status
