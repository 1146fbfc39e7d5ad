"""The command `nsdr`: which commands there are, and how they end."""

import io
import logging
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import jsonargparse

from nsdr.cli.common import Command
from nsdr.errors import DataError, NsdrError, machine_error
from nsdr.io.configuration import OptionParser
from nsdr.io.limits import limits
from nsdr.io.registry import installed_part

COMMANDS: dict[str, tuple[str, str]] = {
    "answer": ("ask", "answer a question about a video"),
    "parse-question": ("ask", "turn a question or choice into a program"),
    "execute": ("ask", "run a program on a saved scene"),
    "demo": ("ask", "answer questions about the clip that ships with the package"),
    "parse-video": ("perceive", "turn a video into a symbolic scene"),
    "parse-videos": ("perceive", "turn a folder of videos into scenes and proposals; resumable"),
    "predict-dynamics": ("perceive", "turn mask proposals into motion and collisions; resumable"),
    "judge": ("perceive", "find which laws of CLEVRER's world videos break"),
    "visualize": ("perceive", "show what was seen, and why a question got its answer"),
    "simulate": ("simulate", "what would happen in a video with objects removed, changed or added"),
    "evaluate": ("evaluate", "score answers to a question file; resumable"),
    "experiment": ("evaluate", "measure all rows of a table; resumable"),
    "score": ("evaluate", "score a file of answers, or compare two"),
    "compare-videos": ("evaluate", "score continuations by a video model beside noise floors and baselines; resumable"),
    "data verify": ("data", "count the files of a data set"),
    "data download": ("data", "fetch CLEVRER's official files; resumable"),
    "data frames": ("data", "make training frames of videos and their mask proposals; resumable"),
    "data motion": ("data", "make training motion of a data set's proposals and annotations; resumable"),
    "export": ("data", "write a data set as prompts or conversations for training other models; resumable"),
    "mcp": ("serve", "tools for agents (Model Context Protocol) on a folder's videos"),
    "serve": ("serve", "a page to ask and to intervene on"),
    "generate": ("generate", "dataset|violations|scene|questions [--config FILE.yaml] -o OUTPUT [--field value]"),
    "extract-features": (
        "train",
        "[--from truth|proposals] --root DATA -o OUTPUT [--config FILE.yaml] [--field value]",
    ),
    "train": ("train", "PART --config configs/….yaml [--field value]; without a part, says which there are"),
}
"""Of each command, the module of `nsdr.cli` whose `FUNCTIONS` has what runs it, and a summary."""
ERROR, BUG = 2, 70
"""Exit statuses: an error; a bug of ours (EX_SOFTWARE of sysexits.h)."""
BY_SIGNAL = 128
"""Added to a signal's number, as shells do."""
SIGPIPE = 13
"""Number of the signal about a closed pipe, which Windows lacks."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit status: 0; 1 when a part of the work failed; 2 after an error, which is one line on stderr; 70 after a bug of
        ours; 128 + the number of the signal after Ctrl-C, SIGTERM or a closed pipe.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    arguments = [a for a in arguments if a != "--debug"]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names and texts that the terminal's encoding lacks
    logging.basicConfig(level=logging.DEBUG if debug else logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    with warnings.catch_warnings(), interruptible():
        warnings.showwarning = _show_warning
        try:
            status = _run(arguments)
            sys.stdout.flush()
            return status
        except BaseException as e:
            status, message = outcome_of(e)
            if debug:
                traceback.print_exc()
            if message:
                print(message, file=sys.stderr)
            return status


def _run(arguments: list[str]) -> int:
    limits()
    name = next((n for n in (" ".join(arguments[:2]), *arguments[:1]) if n in COMMANDS), "")
    rest = arguments[len(name.split()) :]
    if not name:
        return _overview(arguments)
    module, summary = COMMANDS[name]
    command: Command = import_module(f"nsdr.cli.{module}").FUNCTIONS[name]
    if command.add_options is None:
        return command.run(rest)
    parser = OptionParser(prog=f"nsdr {name}", description=summary, exit_on_error=False)
    command.add_options(parser)
    parser.check_repeated(rest)
    try:
        given = parser.parse_args(rest)
    except jsonargparse.ArgumentError as e:
        raise DataError(f"nsdr {name}: {e}; nsdr {name} --help shows the options") from e
    return command.run(given)


def _overview(arguments: list[str]) -> int:
    """Lists the commands, or those of a first word such as `data`."""
    if arguments[:1] == ["--version"]:
        import nsdr

        print(nsdr.__version__)
        return 0
    asked = arguments[:1] in (["--help"], ["-h"])
    group = {n: row for n, row in COMMANDS.items() if arguments and n.startswith(f"{arguments[0]} ")}
    if arguments and not asked and not (group and arguments[1:2] in (["--help"], ["-h"])):
        known = ", ".join(group or COMMANDS)
        raise DataError(f"nsdr: unknown command {' '.join(arguments[: 1 + bool(group)])!r}; expected one of {known}")
    print("nsdr COMMAND …: answers questions about videos of colliding objects. --help shows a command's options,")
    print("--debug tracebacks; docs/cli.md explains them.\n")
    for name, (_, summary) in (group or COMMANDS).items():
        print(f"  {name:<18}{summary}")
    return 0 if asked or arguments[1:] else ERROR


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)


class Terminated(BaseException):
    """The program got SIGTERM."""


@contextmanager
def interruptible() -> Iterator[None]:
    """The first Ctrl-C or SIGTERM ends the block by an exception, so that workers and files are tidied up; a second one kills.

    Outside of the main thread, where Python does not handle signals, this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: Any) -> None:
        signal.signal(number, signal.SIG_DFL)
        raise KeyboardInterrupt if number == signal.SIGINT else Terminated

    handled = [s for s in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(s) is not signal.SIG_IGN]
    before = {number: signal.signal(number, end) for number in handled}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def outcome_of(error: BaseException) -> tuple[int, str]:
    """The exit status and the line for stderr after an exception that ended the command; other lines are empty."""
    if isinstance(error, SystemExit):
        return (0 if error.code is None else error.code if isinstance(error.code, int) else ERROR), ""
    if isinstance(error, KeyboardInterrupt):
        return BY_SIGNAL + signal.SIGINT, "interrupted"
    if isinstance(error, Terminated):
        return BY_SIGNAL + signal.SIGTERM, "terminated"
    if isinstance(error, BrokenPipeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left to print goes nowhere
        return BY_SIGNAL + SIGPIPE, ""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    elif failure := machine_error(error):
        text = str(failure)
    elif isinstance(error, RecursionError):
        text = "a file or value is nested too deeply"
    elif not isinstance(error, NsdrError | jsonargparse.ArgumentError | FloatingPointError | OSError):
        kind = type(error).__name__
        if part := installed_part(error):
            return ERROR, f"error: {part} failed: {kind}: {text} (--debug shows where)"
        return BUG, f"error: a bug in nsdr, please report it: {kind}: {text} (--debug shows where)"
    return ERROR, f"error: {text}"


if __name__ == "__main__":
    sys.exit(main())
