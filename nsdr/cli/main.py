"""The command `nsdr`: which commands there are, and how errors are reported."""

import logging
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import jsonargparse

from nsdr.cli import agents, ask, data, evaluate, export, figures, options, perceive, score, serve, simulate, tag
from nsdr.cli.status import ERROR, interruptible, left_out, outcome_of
from nsdr.cli.train import PARTS, train
from nsdr.errors import DataError
from nsdr.io.configuration import check_arguments
from nsdr.io.limits import VARIABLE, limits

__all__ = ["main"]

COMMANDS: dict[str, Callable[[Any], int]] = {
    "answer": ask.answer,
    "parse-video": perceive.parse_video,
    "parse-videos": perceive.parse_videos,
    "predict-dynamics": perceive.predict_dynamics,
    "visualize": perceive.visualize,
    "simulate": simulate.simulate,
    "parse-question": ask.parse_question,
    "execute": ask.execute,
    "evaluate": evaluate.evaluate,
    "experiment": evaluate.experiment,
    "score": score.score,
    "dummy": score.dummy,
    "controls": score.controls,
    "tag": tag.tag,
    "data": data.data,
    "export": export.export,
    "figures": figures.figures,
    "mcp": agents.mcp,
    "serve": serve.serve,
    "demo": ask.demo,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit status: 0; 1 when a part of the work failed; 2 after an error, which is one line on stderr; 70 after a bug of
        ours; 128 + the number of the signal after Ctrl-C, SIGTERM or a closed pipe.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in arguments
    arguments = [a for a in arguments if a != "--debug"]
    logging.basicConfig(level=logging.DEBUG if debug else logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    with warnings.catch_warnings(), interruptible(), _changed_limits() as change:
        warnings.showwarning = _show_warning
        try:
            status = _run(change(arguments))
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
    check_arguments(arguments)
    configured = {"train": train, "generate": _generate, "extract-features": _extract_features}.get(
        arguments[0] if arguments else ""
    )
    if configured and arguments[1:2] not in (["--help"], ["-h"]):
        return configured(arguments[1:])
    parser = _parser()
    try:
        given = parser.parse_args(arguments)
    except jsonargparse.ArgumentError as e:
        _, missing, names = str(e).partition("the following arguments are required: ")
        if not missing:
            raise
        command = arguments[0]
        names = names.replace(f"{command}.", "")
        raise DataError(f"nsdr {command}: {missing}{names}; nsdr {command} --help shows them") from e
    if given.command is None:
        parser.print_help()
        return ERROR
    return COMMANDS[given.command](given[given.command])


@contextmanager
def _changed_limits() -> Iterator[Callable[[list[str]], list[str]]]:
    """Takes `--limits NAME=NUMBER,…` out of the arguments, for this process and its workers, until the block ends."""
    before = os.environ.get(VARIABLE)

    def change(arguments: list[str]) -> list[str]:
        left = []
        rest = iter(arguments)
        for argument in rest:
            name, _, value = argument.partition("=")
            if name == "--limits":
                os.environ[VARIABLE] = value or next(rest, "")
                if not os.environ[VARIABLE]:
                    raise DataError("--limits: expected NAME=NUMBER, such as frames=20000")
            else:
                left.append(argument)
        limits()
        return left

    try:
        yield change
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before


def _generate(arguments: list[str]) -> int:
    from nsdr.cli.generate import main as generate

    written = generate(arguments)
    print(written)
    return left_out(written)


def _extract_features(arguments: list[str]) -> int:
    from nsdr.cli.features import main as extract

    written = extract(arguments)
    return left_out(written)


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    print(f"warning: {message}", file=sys.stderr)


def _parser() -> jsonargparse.ArgumentParser:
    parser = jsonargparse.ArgumentParser(
        prog="nsdr",
        exit_on_error=False,
        description="Answer questions about videos of colliding objects. Every command takes --debug for tracebacks, and "
        "--limits NAME=NUMBER,… to read larger files (docs/cli.md).",
    )
    commands = options.Commands(parser)
    options.ask_options(commands)
    options.perceive_options(commands)
    options.evaluate_options(commands)
    score.add_options(commands, options.SPLITS, options.ENGINES)
    options.data_options(commands)
    export.add_options(commands)
    agents.add_options(commands)
    serve.add_options(commands.add("serve", "a page to ask and to intervene on", pipeline=True, videos=True))
    parser.add_argument("--version", action="version", version=_version())
    train_help = f"train {'|'.join(PARTS)} …; the parts: --config configs/….yaml [--field value]"
    generate_help = "generate dataset|scene|questions [--config configs/generate/….yaml] -o OUTPUT [--field value]"
    extract_help = "extract-features --config configs/baselines/features.yaml --root DATA -o OUTPUT [--field value]"
    for name, text in (("train", train_help), ("generate", generate_help), ("extract-features", extract_help)):
        sub = jsonargparse.ArgumentParser(description=f"nsdr {text}; --help after the part shows its fields")
        commands.commands.add_subcommand(name, sub, help=text)
    return parser


def _version() -> str:
    import nsdr

    return nsdr.__version__


if __name__ == "__main__":
    sys.exit(main())
