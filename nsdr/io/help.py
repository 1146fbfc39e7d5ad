"""The help of a command: its options by groups, with types as people write them."""

import argparse
import re
import textwrap
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from msgspec import Meta

from nsdr.validation import words_of

WIDTH, INDENT = 110, 30
"""Longest line, and where the descriptions begin (columns)."""
PLACE = re.compile(r"(?:an? )?(?:[\w-]+ )?(folder or file|file or folder|folder|file)\b", re.IGNORECASE)
"""The beginning of a description of a path."""
CODE = re.compile(r"`([^`]+)`")
"""A field or a name in a description."""
PLACES = {"FOLDER": "FOLDER", "FILE": "FILE"}
"""Words of descriptions that are written as they are; others are any path."""
NOT_SHOWN: tuple[Any, ...] = (None, "", False, [], (), argparse.SUPPRESS)
"""Defaults that are not worth a word."""


def written(kind: Any) -> str:
    """How people write values of a type: `NUMBER`, `TEXT`, `PATH`, `a|b|c`, `[TEXT, …]`, `{TEXT: NUMBER, …}`."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _annotated(*arguments)
    if origin in (Union, UnionType):
        named = str in arguments  # settings that a text may name
        options = [a for a in arguments if a is not NoneType and not (named and is_dataclass(a))]
        return "|".join(dict.fromkeys(map(written, options)))
    if origin is Literal:
        return "|".join("null" if word is None else str(word) for word in arguments if word != "")
    if kind is bool:
        return "true|false"
    if is_dataclass(kind) or kind is NoneType:
        return "null"
    if isinstance(kind, type) and issubclass(kind, int | float):
        return "NUMBER"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return f"{{{written(arguments[0])}: {written(arguments[1])}, …}}"
    if isinstance(origin, type) and issubclass(origin, Sequence | tuple):
        return f"[{written(arguments[0])}, …]"
    return "TEXT"


def _annotated(kind: Any, *rules: Any) -> str:
    for rule in rules:
        if isinstance(rule, Meta) and (words := words_of(rule)):
            return "|".join(words)
        if kind is str and isinstance(rule, Meta) and rule.min_length:
            return "PATH"
    return written(kind)


def expected(kind: Any, default: Any = None) -> str:
    """What an error says of a value of another type than `kind`: how it is written, and the default as an example."""
    if kind is None:
        return "expected settings by name, such as {name: value}, or a YAML file of them"
    section = next((option for option in (kind, *get_args(kind)) if is_dataclass(option)), None)
    if section is not None:
        none = "null, or " if NoneType in get_args(kind) else ""
        return f"expected {none}settings by name, such as {{{fields(section)[0].name}: …}}"
    if get_origin(kind) in (Union, UnionType):
        kind = next((option for option in get_args(kind) if option is not NoneType), kind)
    base = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    how = "a text that is not empty" if "not-empty" in (base.__doc__ or "") else written(kind)
    if how == "NUMBER":
        rule = (base.__doc__ or "").partition("restricted to be ")[2]  # of a type such as jsonargparse's PositiveInt
        how = " ".join(["a whole number" if issubclass(base, int) else "a number", *([rule] if rule else [])])
    example = as_typed(default) if how[:1] in ("[", "{") and default else ""
    return f"expected {how}, such as '{example}'" if example else f"expected {how}"


def as_typed(value: Any) -> str:
    """A default as people type it: `[a, b]`, `{a: 1}`, `true`."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_typed, value))}]"
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{key}: {as_typed(item)}' for key, item in value.items())}}}"
    return str(value).lower() if isinstance(value, bool) else str(value)


def formatted_help(parser: Any, needed: Sequence[str], groups: Mapping[str, Sequence[str]], more: Sequence[str]) -> str:
    """The help of a parser.

    Settings of sections (`--loop.steps`) are not described one by one: the sections are named.

    Args:
        parser: of jsonargparse.
        needed: names of what is required.
        groups: names of options by headings, which stand in this order after all other options.
        more: names of options that are listed without a description.
    """
    actions = [a for a in parser._actions if a.help != argparse.SUPPRESS and a.dest not in more]
    named = {a.dest for a in actions if str in get_args(getattr(a, "_typehint", None))}  # settings that a text may name
    of_sections = (a.dest.split(".")[0] for a in actions if "." in a.dest or _is_section(a))
    sections = {name: None for name in of_sections if name not in named}
    shown = [a for a in actions if "." not in a.dest and (a.dest not in sections or _may_be_none(a))]
    grouped = {name for names in groups.values() for name in names}
    options = {a.dest for a in parser._actions if a.option_strings}
    rows = {
        "arguments": [a for a in shown if not a.option_strings],
        "options": [a for a in shown if a.option_strings and a.dest not in grouped],
        **{title: [a for a in shown if a.option_strings and a.dest in names] for title, names in groups.items()},
    }
    usage = [_value(a) for a in rows["arguments"]]
    usage += [_invocation(a, names=1) for a in shown if a.option_strings and a.dest in needed]
    lines = [
        f"usage: {' '.join([parser.prog, *usage, '[options]'])}",
        "",
        *textwrap.wrap(parser.description or "", WIDTH),
    ]
    for title, listed in rows.items():
        if listed:
            lines += ["", f"{title}:", *(line for a in listed for line in _described(a, a.dest in needed, options))]
    if sections:
        about = "settings of a section; --config FILE has them, too, and --print-config prints all"
        lines += ["", "sections:", *_row(", ".join(f"--{_dashed(name)}.NAME" for name in sections), about)]
    if more:
        lines += [
            "",
            "more (the documentation's page 'Command line'):",
            *_wrapped(", ".join(f"--{_dashed(name)}" for name in more), "  "),
        ]
    return "\n".join([*lines, *(["", *_wrapped(parser.epilog, "")] if parser.epilog else []), ""])


def _is_section(action: Any) -> bool:
    kind = getattr(action, "_typehint", None)
    return any(is_dataclass(option) for option in (kind, *get_args(kind)))


def _may_be_none(action: Any) -> bool:
    return NoneType in get_args(getattr(action, "_typehint", None))


def _described(action: argparse.Action, required: bool, names: Container[str]) -> Iterator[str]:
    about = " ".join((action.help or "").split()).replace("%%", "%").rstrip(".")
    about = CODE.sub(lambda m: f"--{_dashed(m[1])}" if m[1] in names else m[1], about)
    if action.dest == "print_config":
        about = "print all settings as a YAML file, and do nothing else"
    default = _default(action)
    shows = [] if default is None or "(default" in about else [f"default: {default}"]
    notes = [*(["required"] if action.option_strings and required else []), *shows]
    yield from _row(_invocation(action), f"{about} ({', '.join(notes)})" if notes else about)


def _default(action: argparse.Action) -> str | None:
    value = action.default
    if any(value is none or value == none for none in NOT_SHOWN) or not action.option_strings or _is_section(action):
        return None
    return " ".join(map(str, value)) if action.nargs == "+" else as_typed(value)


def _invocation(action: argparse.Action, names: int = 0) -> str:
    """An option's last `names` names (0 for all) and its value. Those like `--scenes+`, by which lists grow, are left out."""
    value = _value(action)
    if not action.option_strings:
        return value
    listed = [name for name in action.option_strings if not name.endswith("+")][-names:]
    return ", ".join(map(_dashed, listed)) + (f" {value}" if value else "")


def _value(action: argparse.Action) -> str:
    kind = getattr(action, "_typehint", None)
    if action.nargs == 0 or action.dest == "print_config":
        return ""
    if action.choices is not None:
        value = "|".join(str(choice) for choice in action.choices if choice != "")
    elif action.metavar is not None and kind is None:
        value = str(action.metavar)
    elif not action.option_strings:
        value = action.dest.upper()
    else:
        value = written(kind or action.type)
        if value == "TEXT" and (place := PLACE.match(action.help or "")):
            value = PLACES.get(place[1].upper(), "PATH")
    if action.nargs == "?":
        return f"[{value}]"
    return f"{value} …" if action.nargs == "+" else value


def _dashed(name: str) -> str:
    return name.replace("_", "-")


def _row(name: str, about: str) -> list[str]:
    lines = textwrap.wrap(about, WIDTH - INDENT, break_on_hyphens=False) or [""]
    head = f"  {name}"
    first = [f"{head:<{INDENT}}{lines[0]}".rstrip()] if len(head) + 2 <= INDENT else [head, " " * INDENT + lines[0]]
    return [*first, *(" " * INDENT + line for line in lines[1:])]


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
