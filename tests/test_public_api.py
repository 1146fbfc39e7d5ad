"""What version 1 promises to keep (docs/release.md): its list, docs/public_api.txt, is that of the code.

`python -m tests.test_public_api` writes the list anew.
"""

import importlib
import inspect
import io
import pkgutil
import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec

import nsdr
from nsdr.cli import main, train

PAGE = Path(__file__).parent.parent / "docs" / "release.md"
LIST = PAGE.with_name("public_api.txt")
INTERNAL = {
    "apps",
    "cli",
    "continuations",
    "io",
    "language",
    "laws",
    "perception",
    "pipeline_config",
    "training",
    "validation",
    "world",
}
"""Rooms whose names may change."""
MODULES = {"nsdr.clevrer.example", "nsdr.dynamics.base", "nsdr.generate.export", "nsdr.io.video"}
"""Whose names are promised, too: the user's own parts need them (docs/plugins.md), or the examples of the docs."""
ARGUMENTS = {
    "train": list(train.PARTS),
    "data features": ["--from videos", "--from truth"],
}
"""What decides about a command's further options."""


def _parameters(value: Any) -> str:
    return f"({', '.join(name for name in inspect.signature(value).parameters if name != 'self')})"


def _described(name: str, value: Any) -> Iterator[str]:
    """A name with its parameters, and the public methods and properties of a class, if this package gave it them."""
    if not callable(value) or not getattr(value, "__module__", "").startswith("nsdr"):
        yield name
    elif not inspect.isclass(value):
        yield name + _parameters(value)
    else:
        own = [vars(kind) for kind in value.__mro__ if kind.__module__.startswith("nsdr")]
        has_fields = issubclass(value, msgspec.Struct | tuple) or any("__init__" in members for members in own)
        yield name + (_parameters(value) if has_fields else "")
        for key in sorted({key for members in own for key in members if not key.startswith("_")}):
            member = inspect.getattr_static(value, key)
            if isinstance(member, property | cached_property):
                yield f"{name}.{key}"
            elif inspect.isfunction(member) or isinstance(member, classmethod | staticmethod):
                yield f"{name}.{key}{_parameters(getattr(value, key))}"


def _names() -> Iterator[str]:
    rooms = {f"nsdr.{info.name}" for info in pkgutil.iter_modules(nsdr.__path__) if info.name not in INTERNAL}
    known: list[Any] = []
    for module in ("nsdr", *sorted(rooms | MODULES)):
        loaded = importlib.import_module(module)
        for name in sorted(loaded.__all__):
            value = getattr(loaded, name)
            again = any(value is other for other in known)  # described where it was first
            known.append(value)
            yield from [f"{module}.{name}"] if again else _described(f"{module}.{name}", value)


def _commands() -> Iterator[str]:
    """Commands with their options, without those of sections (`--loop.steps`)."""
    for command in main.COMMANDS:
        for words in (f"{command} {argument}".split() for argument in ARGUMENTS.get(command, [""])):
            text = io.StringIO()
            with redirect_stdout(text):
                assert main.main([*words, "--help"]) == 0
            yield f"nsdr {' '.join(words)}"
            heads = re.findall(r"^ {2,4}(-.*?)(?:  |$)", text.getvalue(), flags=re.MULTILINE)
            options = {option for head in heads for option in re.findall(r"(?<![\w.-])--?[a-zA-Z][\w.-]*", head)}
            options |= set(re.findall(r"(--?[a-z][\w-]*) is short for", text.getvalue()))
            for option in sorted(o for o in options - {"-h", "--help", "--print-config"} if "." not in o):
                yield f"nsdr {' '.join(words)} {option}"


def promised() -> list[str]:
    """The list: names with their parameters, commands and options, one a line."""
    return [*_names(), *_commands()]


def test_what_is_promised_is_there() -> None:
    listed, found = LIST.read_text().splitlines(), promised()
    lost, new = sorted(set(listed) - set(found)), sorted(set(found) - set(listed))
    remedy = "`python -m tests.test_public_api` writes the list anew"
    assert not lost, f"promised in {LIST.name}, but gone or changed: {lost}; see {PAGE.name}, then {remedy}. New: {new}"
    assert not new, f"not yet in {LIST.name}: {new}; {remedy}"
    assert listed == found, remedy


def test_the_page_names_what_is_not_promised() -> None:
    named = set(re.findall(r"`nsdr\.(\w+)`", PAGE.read_text().split("## Not promised")[1]))
    assert named == INTERNAL


if __name__ == "__main__":
    LIST.write_text("\n".join(promised()) + "\n")
