"""The one validator of configurations, data types and files: declared types with constraints, checked by msgspec.

A field's type says what it may hold: `Literal["adam", "sgd"]`, `Annotated[float, Meta(ge=0, le=1)]`,
`Annotated[FloatArray, Array("n", 2)]`. Errors name the place, what was expected there and what was found:
`frames[3].objects[0].score: expected a number from 0 to 1, got 1.5`.
"""

import math
import re
import reprlib
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, NotRequired, Required, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta, inspect
from numpy.typing import NDArray

from nsdr.errors import DataError

MAX_SIZE = 65_536
"""Largest width of a network and number of its steps, samples or proposals: more is a mistake, and would fill the memory."""
LARGEST = sys.float_info.max
"""Largest finite number."""

Count = Annotated[int, Meta(ge=0)]
PositiveCount = Annotated[int, Meta(ge=1)]
Size = Annotated[int, Meta(ge=1, le=MAX_SIZE)]
Finite = Annotated[float, Meta(ge=-LARGEST, le=LARGEST)]
NotNegative = Annotated[float, Meta(ge=0, le=LARGEST)]
Positive = Annotated[float, Meta(gt=0, le=LARGEST)]
Share = Annotated[float, Meta(ge=0, le=1)]
PathName = Annotated[str, Meta(pattern=r"^[^\x00]*[^\x00\s][^\x00]*$", title="a path")]
"""Some text without null characters. A `title` is what error messages say is expected."""

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
DTYPES = {FloatArray: "f", IntArray: "iu", BoolArray: "b"}
"""Kinds of numpy's types that an array's type stands for."""

MESSAGE = re.compile(r"(.*?)(?: - at (`key` in )?`\$(.*)`)?", re.DOTALL)
"""A msgspec error: the reason, whether it is a key that is wrong, and the place."""
STEP = re.compile(r"\.([^.\[\]`]+)|\[(\d+|\.\.\.)\]")
"""A step of the place in a msgspec error: a key, an index, or "..." for a value of a mapping."""
WORDS: dict[type, str] = {
    inspect.IntType: "a whole number",
    inspect.FloatType: "a number",
    inspect.StrType: "a text",
    inspect.BoolType: "true or false",
    inspect.NoneType: "null",
    inspect.ListType: "a list",
    inspect.VarTupleType: "a list",
    inspect.TupleType: "a list",
    inspect.DictType: "an object",
    inspect.StructType: "an object",
    inspect.TypedDictType: "an object",
}
"""What a type expects, in words."""
SHORT = reprlib.Repr()
SHORT.maxstring = SHORT.maxother = 50


class Array:
    """What an array may hold, as metadata of a field's type.

    Args:
        shape: lengths. A name is that of a field that holds the number, or a tuple of that length; any other name is one and
            the same length in all arrays of the class.
        low, high: closed range of the values, which are finite.
        nan: whether NaN is allowed.
    """

    def __init__(self, *shape: int | str, low: float = -math.inf, high: float = math.inf, nan: bool = False) -> None:
        self.shape, self.low, self.high, self.nan = shape, low, high, nan


@dataclass(frozen=True)
class Checked:
    """Base of frozen dataclasses: their fields are checked against the declared types on construction.

    Arrays become read-only views of those passed in.

    Raises:
        DataError: names the class, the field, what was expected and what was found.
    """

    _is_named: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_fields(self, f"{type(self).__name__}." if self._is_named else "")


@dataclass(frozen=True)
class Settings(Checked):
    """Base of configurations: `Checked`; errors name the field alone, as files and flags do."""

    _is_named = False


def check_fields(owner: Any, where: str) -> None:
    """What `Checked` does, of any dataclass; `where` stands before the name of the field in errors."""
    kind: Any = type(owner)
    struct, arrays = _declared(kind)
    try:
        msgspec.convert(vars(owner), struct)
    except msgspec.ValidationError:
        convert(_plain(vars(owner)), struct, where)
    if arrays:
        _check_arrays(owner, arrays, where)


def convert(document: Any, kind: Any, where: str = "", place: str = "") -> Any:
    """A value of the type `kind` from plain values, such as the content of a JSON file.

    Args:
        document: dictionaries, lists, texts and numbers.
        kind: a msgspec structure, a `TypedDict`, or a type made of them.
        where: what stands before the place in the document, for error messages: "file.json: ".
        place: the document's place in a larger one, such as "[3]".

    Raises:
        DataError: names the place, what was expected and what was found.
    """
    try:
        return msgspec.convert(document, kind, str_keys=True)
    except msgspec.ValidationError as e:
        raise DataError(explained(e, document, kind, where, place)) from e
    except RecursionError as e:
        raise DataError(f"{where}nested too deeply") from e


def explained(error: msgspec.ValidationError, document: Any, kind: Any, where: str = "", place: str = "") -> str:
    """msgspec's error in words: the place, what was expected, what was found. Arguments are those of `convert`.

    `place` is that of the document in a larger one.
    """
    reason, key, path = MESSAGE.fullmatch(str(error)).groups()  # type: ignore[union-attr]
    value = document
    for name, index in STEP.findall(path or ""):
        kind = _inside(kind, name or index)
        if index == "...":
            for key, item in value.items():
                try:
                    msgspec.convert(item, kind, str_keys=True)
                except msgspec.ValidationError as e:
                    return explained(e, item, kind, where, f"{place}.{key}")
        place += f".{name}" if name else f"[{index}]"
        value = value[name or int(index)] if isinstance(value, Mapping | list | tuple) else getattr(value, name)
    if error.__cause__ is None:
        missing = re.fullmatch(r"Object missing required field `(\w+)`", reason)
        expected = f"keys that are {_expected(_inside(kind, '0'))}" if key else _expected(kind)
        reason = (
            f"missing key {missing[1]!r}"
            if missing
            else f"expected {expected}, got {shown(list(value) if key else value)}"
        )
    elif reason.startswith((".", "[")):
        return f"{where}{(place + reason).removeprefix('.')}"
    return where + (f"{place.removeprefix('.')}: {reason}" if place else reason)


def expect(fits: bool, place: str, expected: str, found: Any) -> None:
    """Raise `DataError` unless a value fits, for rules that types cannot say. What is `found` may be said in words.

    In the `__post_init__` of a msgspec structure, a `place` that begins with "." or "[" is one inside it.
    """
    if not fits:
        raise DataError(f"{place}: expected {expected}, got {found if isinstance(found, str) else shown(found):.80}")


def one_of(words: Iterable[str]) -> Meta:
    """Metadata of a text that is one of these; where they are few and fixed, `Literal` says the same.

    A union of a text with a pattern and a list or mapping crashes msgspec 0.22.
    """
    known = list(words)
    return Meta(
        pattern=f"^({'|'.join(map(re.escape, known))})$", title=f"one of {', '.join(w or repr(w) for w in known)}"
    )


def shown(value: Any) -> str:
    """A value for an error message: one line of about 60 characters at most."""
    try:
        return f"{SHORT.repr(value.item() if isinstance(value, np.generic) else value):.60}"
    except ValueError:  # more digits than Python prints
        return "a huge number"


def _options(kind: Any) -> Iterator[Any]:
    """The members of a union, without annotations."""
    origin = get_origin(kind)
    if origin in (Annotated, NotRequired, Required):
        yield from _options(get_args(kind)[0])
    elif origin in (Union, UnionType):
        for option in get_args(kind):
            yield from _options(option)
    else:
        yield kind


def _inside(kind: Any, step: str) -> Any:
    """The type of a key's value or an item."""
    for option in _options(kind):
        items = [a for a in get_args(option) if a is not Ellipsis]
        if isinstance(option, type) and issubclass(option, msgspec.Struct):
            keys = {f.encode_name: f.type for f in msgspec.structs.fields(option)}
        else:
            keys = {} if items else get_type_hints(option, include_extras=True)
        if step in keys:
            return keys[step]
        if items:
            return items[min(int(step), len(items) - 1)] if step.isdigit() else items[-1]
    return Any


def _expected(kind: Any) -> str:
    """What a type expects, in words: "a number from 0 to 1 or null"."""
    while get_origin(kind) in (NotRequired, Required):
        kind = get_args(kind)[0]
    info = inspect.type_info(kind)
    return " or ".join(_described(i) for i in (info.types if isinstance(info, inspect.UnionType) else (info,)))


def _described(info: Any) -> str:
    if isinstance(info, inspect.Metadata):
        return str((info.extra_json_schema or {}).get("title")) or _described(info.type)
    if isinstance(info, inspect.LiteralType):
        return f"one of {', '.join(str(v) or repr(v) for v in info.values)}"
    name = WORDS.get(type(info)) or f"a {getattr(getattr(info, 'cls', None), '__name__', 'value')}"
    length = getattr(info, "min_length", None), getattr(info, "max_length", None)
    if isinstance(info, inspect.TupleType):
        length = (len(info.item_types),) * 2
    if length != (None, None):
        low, high = length
        unit = "characters" if isinstance(info, inspect.StrType) else "items"
        return f"{name} of {low if low == high else f'{low or 0} to {high}' if high else f'{low} or more'} {unit}"
    if not isinstance(info, inspect.IntType | inspect.FloatType):
        return name
    low, high = (None if n in (None, LARGEST, -LARGEST) else n for n in (info.ge, info.le))
    if info.gt is not None:
        return f"{name} above {info.gt:g}" + ("" if high is None else f", up to {high:g}")
    if info.lt is not None:
        return f"{name} from {low:g}, below {info.lt:g}"
    if low is None and high is None:
        return name.replace("a", "a finite", 1) if info.le is not None else name
    return f"{name} from {low:.10g} " + ("on" if high is None else f"to {high:.10g}")


@cache
def _declared(kind: Any) -> tuple[type[msgspec.Struct], dict[str, tuple[Array, str, bool]]]:
    """A structure with a dataclass's fields but arrays; and of each array what it holds, its dtypes, whether it may be None."""
    hints = get_type_hints(kind, include_extras=True)
    arrays: dict[str, tuple[Array, str, bool]] = {}
    others = []
    for name in (f.name for f in fields(kind) if f.init):
        hint = hints[name]
        for option in (hint, *get_args(hint)):
            for rule in getattr(option, "__metadata__", ()):
                if isinstance(rule, Array):
                    arrays[name] = rule, DTYPES[option.__origin__], NoneType in get_args(hint)
        if name not in arrays:
            others.append((name, _checkable(hint)))
    return msgspec.defstruct(kind.__name__, others), arrays


def _checkable(hint: Any) -> Any:
    """The type, or `Any` where msgspec cannot tell its members apart, as with unions of dataclasses."""
    try:
        inspect.type_info(hint)
    except TypeError:
        return Any
    return hint


def _plain(value: Any) -> Any:
    """A value whose numbers and texts are of Python's own types, not of NumPy's or of other subclasses of them."""
    if isinstance(value, Mapping):
        return {_plain(k): _plain(v) for k, v in value.items()}
    if isinstance(value, tuple):
        return tuple(_plain(v) for v in value)
    if isinstance(value, np.generic):
        return value.item()
    kind = next((k for k in (bool, int, float, str) if isinstance(value, k)), type(value))
    return value if type(value) is kind else kind(value)


def _check_arrays(owner: Any, arrays: Mapping[str, tuple[Array, str, bool]], where: str) -> None:
    """Check shapes, dtypes and values of arrays, and make them read-only."""
    lengths = {k: v if isinstance(v, int) else len(v) for k, v in vars(owner).items() if isinstance(v, int | tuple)}
    for name, (rule, dtypes, may_be_none) in arrays.items():
        value, place = getattr(owner, name), where + name
        if value is None and may_be_none:
            continue
        expect(isinstance(value, np.ndarray), place, "a numpy array", value)
        found = dict(zip(rule.shape, value.shape, strict=False))
        shape = tuple(n if isinstance(n, int) else lengths.setdefault(n, found.get(n, -1)) for n in rule.shape)
        expect(value.shape == shape, place, f"the shape {shape}", value.shape)
        expect(value.dtype.kind in dtypes, place, f"dtype kind {dtypes!r}", value.dtype)
        if value.size and (value.dtype.kind == "f" or rule.low > -math.inf):
            _check_values(value, rule, place)
        view = value.view()  # the caller's own array stays writable
        view.flags.writeable = False
        object.__setattr__(owner, name, view)


def _check_values(array: NDArray[Any], rule: Array, place: str) -> None:
    low, high = array.min(), array.max()
    if not (rule.low <= low <= high <= rule.high and math.isfinite(low) and math.isfinite(high)):
        right = (array >= rule.low) & (array <= rule.high) & np.isfinite(array) | (rule.nan & np.isnan(array))
        if not right.all():
            expected = "finite numbers" if rule.low == -math.inf else f"{rule.low:g} to {rule.high:g}"
            expect(False, place, expected, array[~right][0])
