"""Command line and YAML -> one frozen dataclass: defaults, then the file, then the flags; unknown keys are errors."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

import jsonargparse

from nsdr.errors import DataError
from nsdr.io.reading import read_yaml

__all__ = ["check_arguments", "config_of", "described", "parse_config", "resolved"]

T = TypeVar("T")
UNUSABLE = (jsonargparse.ArgumentError, TypeError, ValueError, KeyError, AttributeError, RecursionError, OSError)
"""What jsonargparse raises about keys and values."""
MAX_BRACKETS = 200
"""Opening brackets of an argument: YAML's parser crashes the process on thousands that are nested."""


def parse_config(kind: type[T], argv: Sequence[str] | None, program: str) -> T:
    """The configuration `kind` from arguments such as `["--config", "a.yaml", "--loop.steps", "10"]`.

    Raises:
        DataError: an unreadable file, an unknown or missing key, or a value of another type or out of its range; names it.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    check_arguments(arguments)
    contents = _files(arguments)
    file, content = contents.get("--config", ("", {}))
    _check_sections(kind, content, file)
    parser = jsonargparse.ArgumentParser(
        prog=program, description=(kind.__doc__ or "").splitlines()[0], exit_on_error=False
    )
    parser.add_argument("--config", action="config", help="a YAML file; flags after it win")
    parser.add_class_arguments(kind, sub_configs=True)
    try:
        values = parser.instantiate(parser.parse_args(arguments)).as_dict()
        values.pop("config")
        return kind(**values)
    except UNUSABLE as e:
        files = ", ".join(name for name, _ in contents.values())
        where = f"{files}: " if files else "" if isinstance(e, DataError) else f"{program}: "
        raise DataError(where + (" ".join(str(e).split()) or type(e).__name__)) from e


def config_of(kind: type[T], values: Mapping[str, Any]) -> T:
    """The configuration `kind` from plain values, such as those of a file.

    Raises:
        DataError: an unknown or missing key, or a value of another type or out of its range; names it.
    """
    parser = jsonargparse.ArgumentParser(exit_on_error=False)
    parser.add_class_arguments(kind, sub_configs=True)
    try:
        return kind(**parser.instantiate(parser.parse_object(dict(values))).as_dict())
    except UNUSABLE as e:
        raise DataError(" ".join(str(e).split()) or type(e).__name__) from e


def check_arguments(arguments: Sequence[str]) -> None:
    """Refuse what crashes YAML's parser.

    Raises:
        DataError: a value with too many brackets; names its option.
    """
    for option, value in zip(["", *arguments], arguments, strict=False):
        if value.count("[") + value.count("{") > MAX_BRACKETS:
            raise DataError(f"{option or 'argument'}: {value[:20]!r}… has more than {MAX_BRACKETS} brackets")


def _files(arguments: Sequence[str]) -> dict[str, tuple[str, dict[str, Any]]]:
    """File and content of the YAML files among the arguments, by option, such as "--config".

    Raises:
        DataError: a file is unreadable or holds something else than a mapping; names it.
    """
    contents = {}
    for option, value in zip(["", *arguments], arguments, strict=False):
        name, separator, attached = value.partition("=")
        if name == "--config" and separator:
            option, value = name, attached
        if option == "--config" or (option.startswith("--") and value.endswith((".yaml", ".yml"))):
            content = read_yaml(value)
            if not isinstance(content, dict):
                raise DataError(f"{value}: expected settings, one `name: value` a line, got {content!r:.40}")
            contents[option] = value, content
    return contents


def _check_sections(kind: Any, content: Mapping[str, Any], where: str) -> None:
    """Sections of nested settings must be sections in the file, too: jsonargparse's errors of others say nothing to a user."""
    known = [field.name for field in fields(kind)]
    for name in content:
        if not isinstance(name, str):
            raise DataError(f"{where}: {name!r} is no name of a setting; expected a text")
        if isinstance(content[name], Mapping) and name.partition(".")[0] not in known:
            raise DataError(f"{where}: {name}: no such setting; known are {', '.join(known)}")
    for field in fields(kind):
        inner = next((t for t in (field.type, *get_args(field.type)) if is_dataclass(t)), None)
        value = content.get(field.name)
        is_absent = field.name not in content or (value is None and inner is not field.type)
        if inner is not None and not is_absent and not isinstance(value, str):
            if not isinstance(value, Mapping):
                raise DataError(
                    f"{where}: {field.name}: expected settings, one `name: value` a line, got {value!r:.40}"
                )
            _check_sections(inner, value, f"{where}: {field.name}")


def resolved(config: Any) -> dict[str, Any]:
    """What a training is told, as plain values: not where it writes (which may move), nor on which device it runs."""
    values = {name: value for name, value in asdict(config).items() if name not in ("run_dir", "output")}
    values["loop"].pop("device")
    return values


def described(config: Any) -> dict[str, Any]:
    """The configuration for readers of a checkpoint: of every path only the last part, which says nothing of the machine."""
    return {k: Path(v).name if isinstance(v, str) and "/" in v else v for k, v in resolved(config).items()}
