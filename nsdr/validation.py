"""The one validator of configurations, data types and files: declared types with constraints, checked by msgspec.

A field's type says what it may hold: `Literal["adam", "sgd"]`, `Annotated[float, Meta(ge=0, le=1)]`,
`Annotated[FloatArray, Array("n", 2)]`. Errors are msgspec's, after the name of the file or of the class and the field:
``proposal_7.json: Expected `float` <= 1.0 - at `$.frames[3].objects[0].score` ``, ``score: Expected `float` <= 1.0, got 2``.
"""

import math
import re
import reprlib
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from types import NoneType
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

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
PathName = Annotated[str, Meta(min_length=1)]
"""The path of a file or folder, which has to be given."""

FloatArray = NDArray[np.floating[Any]]
IntArray = NDArray[np.integer[Any]]
BoolArray = NDArray[np.bool_]
DTYPES = {FloatArray: "f", IntArray: "iu", BoolArray: "b"}
"""Kinds of numpy's types that an array's type stands for."""

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
        DataError: names the class, the field and what was expected.
    """

    _is_named: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_fields(self, f"{type(self).__name__}: " if self._is_named else "")


@dataclass(frozen=True)
class Settings(Checked):
    """Base of configurations: `Checked`; errors name the field alone, as files and flags do."""

    _is_named = False


def check_fields(owner: Any, where: str) -> None:
    """Check the fields of any dataclass as `Checked` does; errors begin with `where`."""
    kind: Any = type(owner)
    struct, arrays = _declared(kind)
    given = {name: getattr(owner, name) for name in struct.__struct_fields__}  # msgspec leaves defaults out of `vars`
    try:
        msgspec.convert(given, struct)
    except msgspec.ValidationError:
        values = _plain(given)
        try:
            convert(values, struct)
        except DataError as e:
            raise DataError(where + _of_field(str(e), values, get_type_hints(kind, include_extras=True))) from e
    if arrays:
        _check_arrays(owner, arrays, where)


def convert(document: Any, kind: Any, where: str = "") -> Any:
    """A value of the type `kind` from plain values, such as the content of a JSON file.

    Args:
        document: dictionaries, lists, texts and numbers.
        kind: a msgspec structure, a `TypedDict`, or a type made of them.
        where: the file or the place in it, with which error messages begin: "file.json: ".

    Raises:
        DataError: msgspec's message, which says what was expected, and at which place.
    """
    try:
        return msgspec.convert(document, kind, str_keys=True)
    except msgspec.ValidationError as e:
        raise DataError(f"{where}{said(e)}") from e
    except RecursionError as e:
        raise DataError(f"{where}nested too deeply") from e


def expect(fits: bool, place: str, expected: str, found: Any) -> None:
    """Raise `DataError` unless a value fits, for rules that types cannot say. What is `found` may be said in words."""
    if not fits:
        raise DataError(f"{place}: expected {expected}, got {found if isinstance(found, str) else shown(found):.80}")


def one_of(words: Iterable[str]) -> Meta:
    """Metadata of a text that is one of these; where they are few and fixed, `Literal` says the same.

    A union of a text with a pattern and a list or mapping crashes msgspec 0.22.
    """
    return Meta(pattern=f"^({'|'.join(map(re.escape, words))})$")


def words_of(rule: Meta) -> list[str]:
    """The words of `one_of`; none of other metadata."""
    pattern = rule.pattern or ""
    return (
        re.sub(r"\\(.)", r"\1", pattern[2:-2]).split("|") if pattern.startswith("^(") and pattern.endswith(")$") else []
    )


def said(error: msgspec.ValidationError) -> str:
    """What a type expected: msgspec's message, with the words of `one_of` in place of their pattern."""
    before, expected, after = str(error).partition("`str` matching regex '")
    pattern, _, place = after.rpartition("'")
    words = words_of(Meta(pattern=pattern)) if expected else []
    return f"{before}one of {', '.join(words)}{place}" if words else str(error)


def shown(value: Any) -> str:
    """A value for an error message: one line of about 60 characters at most."""
    try:
        return f"{SHORT.repr(value.item() if isinstance(value, np.generic) else value):.60}"
    except ValueError:  # more digits than Python prints
        return "a huge number"


def _of_field(message: str, values: Mapping[str, Any], hints: Mapping[str, Any]) -> str:
    """msgspec's message about the value of a field as "score: Expected `float` <= 1.0, got 2"; those about parts of it stay."""
    for name, value in values.items():
        expected = message.removesuffix(f" - at `$.{name}`")
        if expected != message:
            if get_origin(hints[name]) is Literal:
                expected = f"Expected one of {', '.join(str(word) or repr('') for word in get_args(hints[name]))}"
            return f"{name}: {expected}" if ", got " in expected else f"{name}: {expected}, got {shown(value)}"
    return message


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
