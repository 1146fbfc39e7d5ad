"""Command line and YAML -> one frozen dataclass: defaults, then the file, then the flags; unknown keys are errors."""

import argparse
import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from itertools import pairwise
from types import MappingProxyType, NoneType
from typing import Any, NoReturn, TypeVar, get_args, get_type_hints

import jsonargparse

from nsdr.errors import DataError
from nsdr.io.help import expected, formatted_help
from nsdr.io.reading import read_yaml
from nsdr.io.shipped import find_config
from nsdr.validation import convert
from nsdr.world.world import World

T = TypeVar("T")
MISSING, WRONG = "the following arguments are required: ", re.compile(r'(?:Parser key "|argument --)([\w.-]+)')
"""How jsonargparse's messages name keys that are missing, and keys of wrong values (one in a section after that)."""
UNUSABLE = (jsonargparse.ArgumentError, TypeError, ValueError, KeyError, AttributeError, RecursionError, OSError)
"""What jsonargparse raises about keys and values."""


class OptionParser(jsonargparse.ArgumentParser):
    """A parser whose options are spelled with dashes, also where a field of a configuration has underscores.

    It refuses an option that is given twice, of which argparse drops the first value without a word, and the beginning of an
    option's name, which means another option when one is added.

    Attributes:
        headings: names of options by their headings in the help; the others stand before them.
        more: names of options that the help lists without describing them.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, allow_abbrev=False, **options)
        self.headings: dict[str, tuple[str, ...]] = {}
        self.more: tuple[str, ...] = ()
        self._needed: list[str] = []
        self._given: list[str] = []

    def parse_args(self, args: Any = None, *others: Any, **named: Any) -> Any:
        """As argparse, but for the spelling; raises `DataError` for an option with underscores."""
        arguments = sys.argv[1:] if args is None else list(args)
        self._given = arguments
        self._needed = [a.dest for a in self._actions if a.required]  # jsonargparse hides it from argparse
        end = arguments.index("--") if "--" in arguments else len(arguments)
        return super().parse_args([*map(self._of_field, arguments[:end]), *arguments[end:]], *others, **named)

    def format_help(self, formatter: Any = None) -> str:
        """The options by groups, with types as people write them."""
        return formatted_help(self, self._needed, self.headings, self.more)

    def error(self, message: str, ex: Exception | None = None) -> NoReturn:
        """Raises `ArgumentError`: which option is wrong, as it is typed, and how its value is written; or which are missing."""
        actions = {action.dest: action for action in self._actions}
        missing = message.removeprefix(MISSING)
        if missing != message:
            names = [option(key) if actions[key].option_strings else key.upper() for key in missing.split(", ")]
            raise jsonargparse.ArgumentError(None, f"{', '.join(names)} must be given") from ex
        key = ".".join(dict.fromkeys(key.replace("-", "_") for key in WRONG.findall(message)))
        known = key
        while known not in actions and "." in known:
            known = known.rpartition(".")[0]
        if known not in actions:
            raise jsonargparse.ArgumentError(None, message) from ex
        kind, default = getattr(actions[known], "_typehint", None) or actions[known].type, actions[known].default
        # Fields of a section that may be null are no actions.
        for name in key.removeprefix(known).split(".")[1:]:
            section = next((k for k in (kind, *get_args(kind)) if is_dataclass(k)), None)
            if section is None:  # a list of sections
                break
            kind, default = get_type_hints(section, include_extras=True)[name], None
        words = [str(word) for word in actions[known].choices or () if word != ""]
        wanted, got = (
            f"expected {'|'.join(words)}" if words else expected(kind, default),
            self._value_of(actions[known]),
        )
        error = jsonargparse.ArgumentError(None, wanted if got is None else f"{wanted}, got {got:.60}")
        error.argument_name = option(key)
        raise error from ex

    def _value_of(self, action: argparse.Action) -> str | None:
        """What was given for an option; None if that is not one text."""
        names = [name.replace("_", "-") for name in action.option_strings]
        for argument, following in pairwise([*self._given, ""]):
            name, equals, value = argument.partition("=")
            if name in names and action.nargs is None:
                return value if equals else following
        return None

    def _of_field(self, argument: str) -> str:
        """An argument with the name that jsonargparse gives the option of a field."""
        name, equals, value = argument.partition("=")
        if not name.startswith("--") or (name in ("--", *self._option_string_actions) and "_" not in name):
            return argument
        if "_" in name:
            raise DataError(f"{name}: options are spelled with dashes: {name.replace('_', '-')}")
        field = f"--{name[2:].replace('-', '_')}"
        return field + equals + value if field in self._option_string_actions or "." in field else argument

    def check_repeated(self, arguments: Sequence[str]) -> None:
        """Raises `DataError` where an option is there twice that is not to be repeated; names it."""
        actions = {name: action for action in self._actions for name in action.option_strings}
        given = []
        for argument in arguments:
            name = argument.partition("=")[0]
            if not name.startswith("--"):
                name = name[:2]  # the value may follow without a space
            action = actions.get(name) or actions.get(name[:2] + name[2:].replace("-", "_"))
            if isinstance(action, argparse._AppendAction | jsonargparse.ActionConfigFile):
                continue
            if action is not None or name.startswith("--"):
                given.append("/".join(action.option_strings).replace("_", "-") if action else name)
        for name, times in Counter(given).items():
            if times > 1:
                raise DataError(f"{name} is given {times} times, of which one alone would count; give it once")


def parse_config(
    kind: type[T],
    argv: Sequence[str] | None,
    program: str,
    epilog: str = "",
    short: Mapping[str, str] = MappingProxyType({}),
    group: str = "",
) -> T:
    """The configuration `kind` from arguments such as `["--config", "a.yaml", "--loop.batch-size", "10"]`.

    Args:
        kind: the dataclass.
        argv: the arguments; None for those of the command line.
        program: the command's name, for its help and error messages.
        epilog: what its help says at the end.
        short: other names of options, such as {"-o": "--output"}; the help lists them.
        group: the folder of `configs` whose files `--config` takes by their names (see `find_config`); "" for none.

    Raises:
        DataError: an unreadable file, an unknown or missing key, or a value of another type or out of its range; names it.
    """
    given = list(sys.argv[1:] if argv is None else argv)
    arguments = _with_files([_in_full(a, short) for a in given], group)
    options = [*pairwise(arguments), *(a.split("=", 1) for a in arguments if a.startswith("--") and "=" in a)]
    for name, value in options:
        _check_option(name, value)
    files = [value for name, value in options if name == "--config"]
    for file in files:
        content = read_yaml(file)
        _check_spaces(content, file)
        check_sections(kind, content, file)
    about = (kind.__doc__ or "").splitlines()[0]
    end = " ".join([*(f"{name} is short for {option}." for name, option in short.items()), epilog]).strip()
    parser = OptionParser(prog=program, description=about, epilog=end or None, exit_on_error=False)
    parser.add_argument(
        "--config", action="config", help="a YAML file, or the name of one that ships; flags after it win"
    )
    parser.add_class_arguments(kind)
    parser.check_repeated(arguments)
    try:
        values = parser.instantiate(parser.parse_args(arguments)).as_dict()
        values.pop("config")
        return kind(**values)
    except UNUSABLE as e:
        for file in files:  # jsonargparse names a list, but not what is wrong in it
            if isinstance(world := read_yaml(file).get("world"), Mapping):
                convert(world, World, f"{file}: world: ")
        if isinstance(e, jsonargparse.ArgumentError) and (wrong := e.argument_name):
            names = [a.partition("=")[0] for a in given]
            asked = [n for n in names if short.get(n, n).replace("_", "-") == wrong]
            where = asked[:1] or [f"{', '.join(files) or program}: {wrong[2:].replace('-', '_')}"]
            got = [f", got {value:.60}" for n, value in options if asked and n.replace("_", "-") == wrong]
            raise DataError(f"{where[0]}: {e.message.partition(', got ')[0]}{got[0] if got else ''}") from e
        message = " ".join(str(e).split()) or type(e).__name__
        where = _at_fault(given, short, message) or files or ([] if isinstance(e, DataError) else [program])
        names_it = not where or message.startswith(("--", "unrecognized arguments"))
        field = f"{where[0].lstrip('-').replace('-', '_')}: " if where else ""
        raise DataError(message if names_it else f"{', '.join(where)}: {message.removeprefix(field)}") from e


def _with_files(arguments: Sequence[str], group: str) -> list[str]:
    """The arguments with the files of configurations in place of their names."""
    found = []
    for before, argument in pairwise(["", *arguments]):
        if group and argument.startswith("--config="):
            argument = f"--config={find_config(argument.partition('=')[2], group)}"
        found.append(str(find_config(argument, group)) if group and before == "--config" else argument)
    return found


def _at_fault(given: Sequence[str], short: Mapping[str, str], message: str) -> list[str]:
    """The options, as they are given, whose fields a message names: `--steps` of "… at `$.steps`"."""
    found = []
    for name in (argument.partition("=")[0] for argument in given if argument.startswith("-")):
        field = short.get(name, name).rpartition(".")[2].lstrip("-").replace("-", "_")
        if field != "config" and re.search(rf"(^|[.\"]){re.escape(field)}\b", message):
            found.append(name)
    return found


def option(field: str) -> str:
    """The option of a field, such as "--loop.batch-size" of "loop.batch_size"."""
    return f"--{field.replace('_', '-')}"


def _in_full(argument: str, short: Mapping[str, str]) -> str:
    """An argument with an option's full name in place of a short one."""
    name, equals, value = argument.partition("=")
    return short.get(name, name) + equals + value


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


def _check_option(name: str, value: str) -> None:
    import yaml

    with suppress(yaml.YAMLError):
        if value.startswith("{"):
            _check_spaces(yaml.safe_load(value), f"{name} {value}")


def _check_spaces(content: Any, where: str) -> None:
    """Refuse `{3:1.0}`, which YAML takes for a key without a value, and such a key for a number to the base of 60."""
    for key, value in content.items() if isinstance(content, Mapping) else ():
        if value is None and (isinstance(key, float) or ":" in str(key)):
            raise DataError(f"{where}: expected a space after each colon, such as {{a: 1}}")
        _check_spaces(value, where)


def check_sections(kind: Any, content: Any, where: str) -> None:
    """Refuse names and sections that a dataclass does not have, at any depth; `where` names the file or the place in it."""
    if not isinstance(content, Mapping):
        raise DataError(f"{where}: expected settings, one `name: value` a line, got {content!r:.40}")
    kinds = {field.name: field.type for field in fields(kind)}
    for name, value in content.items():
        if not isinstance(name, str):
            raise DataError(f"{where}: {name!r} is no name of a setting; expected a text")
        if name.partition(".")[0] not in kinds:
            raise DataError(f"{where}: {name}: no such setting; known are {', '.join(kinds)}")
        options = (kinds.get(name), *get_args(kinds.get(name)))
        section = next((option for option in options if is_dataclass(option)), None)
        if section is not None and not (value is None and NoneType in options):
            check_sections(section, value, f"{where}: {name}")
        entry = next((part for option in options for part in get_args(option) if is_dataclass(part)), None)
        for index, part in enumerate(value if entry is not None and isinstance(value, list) else ()):
            check_sections(entry, part, f"{where}: {name}[{index}]")
