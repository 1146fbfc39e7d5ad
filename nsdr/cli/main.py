"""The command `nsdr`: which commands there are, and how they end."""

import io
import logging
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import jsonargparse

from nsdr.cli.common import Command
from nsdr.errors import DataError, NsdrError, machine_error
from nsdr.io.configuration import OptionParser
from nsdr.io.limits import limits
from nsdr.io.registry import installed_part

COMMANDS: dict[str, tuple[str, str, str]] = {
    "answer": ("ask", "ask", "answer questions about a video"),
    "simulate": ("ask", "simulate", "what would happen in a video with objects removed, changed or added"),
    "judge": ("ask", "perceive", "find which laws of their world videos break"),
    "visualize": ("ask", "perceive", "show what was seen, and why a question got its answer"),
    "demo": ("ask", "ask", "answer questions about the clip that ships with the package"),
    "serve": ("ask", "serve", "a page to ask and to intervene on"),
    "mcp": ("ask", "serve", "tools for agents (Model Context Protocol) on a folder's videos"),
    "parse": ("process", "parse", "turn videos or mask proposals into symbolic scenes; resumable"),
    "program": ("process", "ask", "turn a question or choice into a program, or run one on a saved scene"),
    "evaluate": ("measure", "evaluate", "score answers to a question file; resumable"),
    "score": ("measure", "evaluate", "score a file of answers, or compare two"),
    "experiment": ("measure", "evaluate", "measure all rows of a table; resumable"),
    "compare-videos": ("measure", "evaluate", "score continuations by a video model beside baselines; resumable"),
    "data verify": ("data", "data", "count the files of a data set"),
    "data download": ("data", "data", "fetch CLEVRER's official files; resumable"),
    "data frames": ("data", "data", "make training frames of videos and their mask proposals; resumable"),
    "data motion": ("data", "data", "make training motion of a data set's proposals and annotations; resumable"),
    "data features": ("data", "data", "make features of videos for the baselines; resumable"),
    "generate dataset": ("data", "generate", "make videos, annotations, proposals and questions; resumable"),
    "generate violations": ("data", "generate", "make pairs of videos, one of which breaks a law; resumable"),
    "generate scene": ("data", "generate", "make the truth file of one scene"),
    "generate questions": ("data", "generate", "make balanced questions about scenes whose truth is known"),
    "export": ("data", "data", "write a data set as prompts or conversations for training other models; resumable"),
    "train": ("train", "train", "train a part; `nsdr train --help` lists them"),
}
"""Of each command, its group in the help, the module of `nsdr.cli` whose `FUNCTIONS` has what runs it, and a summary."""
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
    _, module, summary = COMMANDS[name]
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
    first = arguments[0] if arguments else ""
    parts = {name: row for name, row in COMMANDS.items() if name.startswith(f"{first} ")}
    if arguments and not asked and not (parts and arguments[1:2] in (["--help"], ["-h"])):
        known = ", ".join(parts or dict.fromkeys(name.split()[0] for name in COMMANDS))
        raise DataError(f"nsdr: unknown command {' '.join(arguments[: 1 + bool(parts)])!r}; expected one of {known}")
    if parts:
        print(f"nsdr {first} PART …; nsdr {first} PART --help shows the options of a part.\n")
        _print_table({name: summary for name, (*_, summary) in parts.items()})
        return 0
    print(
        "nsdr COMMAND …: answers questions about videos of colliding objects. nsdr COMMAND --help shows a command's options,"
    )
    print("--debug tracebacks; the documentation's page 'Command line' explains them.")
    for group in dict.fromkeys(group for group, *_ in COMMANDS.values()):
        print(f"\n{group}:")
        _print_table(_summaries(group))
    return 0 if asked else ERROR


def _summaries(group: str) -> dict[str, str]:
    """What the commands of a group do; commands of two words are one, whose second words are listed."""
    found: dict[str, str] = {}
    for name, (its_group, _, summary) in COMMANDS.items():
        first, _, part = name.partition(" ")
        if its_group == group:
            found[first] = f"{found[first]}|{part}" if first in found else part or summary
    return found


def _print_table(summaries: Mapping[str, str]) -> None:
    width = max(map(len, summaries)) + 2
    for name, summary in summaries.items():
        print(f"  {name:<{width}}{summary}")


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
