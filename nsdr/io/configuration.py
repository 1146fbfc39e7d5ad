"""Command line and YAML -> one frozen dataclass: defaults, then the file, then the flags; unknown keys are errors."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cached_property
from itertools import pairwise
from types import NoneType
from typing import Any, TypeVar, get_args

import jsonargparse

from nsdr.errors import DataError
from nsdr.io.reading import read_yaml

T = TypeVar("T")
UNUSABLE = (jsonargparse.ArgumentError, TypeError, ValueError, KeyError, AttributeError, RecursionError, OSError)
"""What jsonargparse raises about keys and values."""


class OptionParser(jsonargparse.ArgumentParser):
    """A parser that refuses an option that is given twice, of which argparse drops the first value without a word."""

    def add_argument(self, *args: Any, **kwargs: Any) -> Any:
        """As that of argparse; an option with the action "append" or "config" may be repeated."""
        added = super().add_argument(*args, **kwargs)
        names = dict.fromkeys(added.option_strings, "/".join(added.option_strings))
        if isinstance(self, OptionParser):  # jsonargparse also gives this method to its groups
            (self.repeatable if kwargs.get("action") in ("append", "config") else self.once).update(names)
        return added

    @cached_property
    def once(self) -> dict[str, str]:
        """How an option is shown to users by each of its names, for options that count once."""
        return {}

    @cached_property
    def repeatable(self) -> dict[str, str]:
        """The same of options that may be repeated."""
        return {}

    def check_repeated(self, arguments: Sequence[str]) -> None:
        """Raises `DataError` where an option that counts once is there twice; names it."""
        names = (a.partition("=")[0] for a in arguments)
        given = [n for n in names if n in self.once or (n.startswith("--") and n not in self.repeatable)]
        for name, times in Counter(self.once.get(n, n) for n in given).items():
            if times > 1:
                raise DataError(f"{name} is given {times} times, of which one alone would count; give it once")


def parse_config(kind: type[T], argv: Sequence[str] | None, program: str, epilog: str = "") -> T:
    """The configuration `kind` from arguments such as `["--config", "a.yaml", "--loop.steps", "10"]`.

    Args:
        kind: the dataclass.
        argv: the arguments; None for those of the command line.
        program: the command's name, for its help and error messages.
        epilog: what its help says at the end.

    Raises:
        DataError: an unreadable file, an unknown or missing key, or a value of another type or out of its range; names it.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    for name, value in pairwise(arguments):
        _check_spaces(name, value)
    files = [value for name, value in pairwise(arguments) if name == "--config"]
    files += [value.removeprefix("--config=") for value in arguments if value.startswith("--config=")]
    for file in files:
        _check_sections(kind, read_yaml(file), file)
    about = (kind.__doc__ or "").splitlines()[0]
    parser = OptionParser(prog=program, description=about, epilog=epilog or None, exit_on_error=False)
    parser.add_argument("--config", action="config", help="a YAML file; flags after it win")
    parser.add_class_arguments(kind)
    parser.check_repeated(arguments)
    try:
        values = parser.instantiate(parser.parse_args(arguments)).as_dict()
        values.pop("config")
        return kind(**values)
    except UNUSABLE as e:
        where = f"{', '.join(files)}: " if files else "" if isinstance(e, DataError) else f"{program}: "
        raise DataError(where + (" ".join(str(e).split()) or type(e).__name__)) from e


def config_of(kind: type[T], values: Mapping[str, Any]) -> T:
    """The configuration `kind` from plain values, such as those of a file.

    Raises:
        DataError: an unknown or missing key, or a value of another type or out of its range; names it.
    """
    parser = jsonargparse.ArgumentParser(exit_on_error=False)
    parser.add_class_arguments(kind)
    try:
        return kind(**parser.instantiate(parser.parse_object(dict(values))).as_dict())
    except UNUSABLE as e:
        raise DataError(" ".join(str(e).split()) or type(e).__name__) from e


def _check_spaces(name: str, value: str) -> None:
    """Refuse `{3:1.0}`, which YAML takes for a key without a value, and such a key for a number to the base of 60."""
    import yaml

    with suppress(yaml.YAMLError):
        content = yaml.safe_load(value) if value.startswith("{") else {}
        if any(v is None and (isinstance(k, float) or ":" in str(k)) for k, v in content.items()):
            raise DataError(f"{name} {value}: expected a space after each colon, such as {{a: 1}}")


def _check_sections(kind: Any, content: Any, where: str) -> None:
    """Refuse names and sections of a file about which jsonargparse's errors say nothing to a user."""
    if not isinstance(content, Mapping):
        raise DataError(f"{where}: expected settings, one `name: value` a line, got {content!r:.40}")
    kinds = {field.name: field.type for field in fields(kind)}
    for name, value in content.items():
        if not isinstance(name, str):
            raise DataError(f"{where}: {name!r} is no name of a setting; expected a text")
        if isinstance(value, Mapping) and name.partition(".")[0] not in kinds:
            raise DataError(f"{where}: {name}: no such setting; known are {', '.join(kinds)}")
        options = (kinds.get(name), *get_args(kinds.get(name)))
        section = next((option for option in options if is_dataclass(option)), None)
        if section is not None and not (value is None and NoneType in options):
            _check_sections(section, value, f"{where}: {name}")
