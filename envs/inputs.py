"""Turns TOML tables into checked values, and mistakes into messages of one sentence.

All input is checked here: scenarios, experiments and algorithm settings are subclasses of `Table`,
and `parse` reads them.
"""

import difflib
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, NoReturn, Self, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    SerializerFunctionWrapHandler,
    Tag,
    ValidationError,
    model_serializer,
)
from pydantic_core import ErrorDetails

_LONGEST_MESSAGE: Final = 300  # characters
_MOST_MESSAGES: Final = 10
_LONGEST_VALUE: Final = 80  # characters of a value that a message repeats
_SHORTEST_LIST: Final = 40  # characters of accepted names that a message has room for
_LONGEST_NAME: Final = 60  # characters of a name that is compared with others
_LARGEST_FILE: Final = 1_000_000  # bytes
_DEEPEST: Final = 32  # tables inside tables
_TOO_DEEP: Final = f"nested too deeply; accepted: at most {_DEEPEST} levels"
_MOST_DIGITS: Final = 4300  # of a number, by default in Python
_TOO_LARGE: Final = 10**_MOST_DIGITS
_TOO_LONG: Final = f"too many digits; accepted: at most {_MOST_DIGITS:,}"

_NAME_RULE: Final = (
    "a name of at most 60 letters, digits, _ and -, the first a letter or digit; no number, true, false, NA, "
    "or device of Windows (con, nul)"
)
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")
_DEVICE: Final = re.compile(r"con|prn|aux|nul|(com|lpt)[0-9]", re.IGNORECASE)  # no file can have such a name
# Names that pandas or R would read as numbers, booleans or missing values.
_VALUE: Final = re.compile(r"[0-9]+(e-?[0-9]+)?|inf|infinity|na|nan|none|null|true|false", re.IGNORECASE)
# Control characters, among them line separators and those of writing direction, and lone surrogates.
_CONTROL: Final = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
_BREAK: Final = re.compile(r"[\n\t]")


class InputError(ValueError):
    """One or more mistakes in the user's input, each described by a line that can be shown as it is."""

    def __init__(self, *messages: str) -> None:
        lines = [*dict.fromkeys(map(_as_line, messages))]
        n_more = len(lines) - _MOST_MESSAGES
        super().__init__(*lines[:_MOST_MESSAGES], *[f"and {n_more:,} more."] * (n_more > 0))

    def __str__(self) -> str:
        return "\n".join(self.args)


def _as_line(message: str) -> str:
    line = " ".join("".join(c if c.isprintable() or c.isspace() else "?" for c in message).split())
    if len(line) > _LONGEST_MESSAGE:  # leaves out the folders of the file, and then the middle
        line = re.sub(r"^[^ ]*/(?=[^ /]+:)", ".../", line)
    if len(line) > _LONGEST_MESSAGE:
        line = f"{line[: _LONGEST_MESSAGE // 2 - 5]} ... {line[-_LONGEST_MESSAGE // 2 :]}"
    return line


class Table(BaseModel):
    """A frozen table of named values. It refuses unknown keys, wrong types, NaN and infinity."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    # Keys that are not written while they have their defaults: they were added after runs had been published,
    # whose digests must stay the same.
    omitted_at_default: ClassVar[Set[str]] = frozenset()

    # Cached properties are neither compared nor copied nor pickled.
    def _given(self) -> dict[str, object]:
        return {key: self.__dict__[key] for key in type(self).model_fields}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Table) and type(self) is type(other) and self._given() == other._given()

    def __hash__(self) -> int:
        values = self._given().values()
        return hash(tuple(tuple(value.items()) if isinstance(value, dict) else value for value in values))

    def __copy__(self) -> Self:  # for `model_copy`, which may change fields
        copied = super().__copy__()
        object.__setattr__(copied, "__dict__", self._given())
        return copied

    def __getstate__(self) -> dict[Any, Any]:
        return super().__getstate__() | {"__dict__": self._given()}

    @model_serializer(mode="wrap")
    def _without_defaults(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = handler(self)
        for key in self.omitted_at_default & written.keys():
            if getattr(self, key) == type(self).model_fields[key].get_default(call_default_factory=True):
                del written[key]
        return written


TableT = TypeVar("TableT", bound=Table)


def require(is_met: bool, found: str, accepted: str) -> None:
    """Raises a ValueError, to which `parse` adds file and key, if a condition of a `Table` is not met."""
    if not is_met:
        raise ValueError(f"{found}: accepted: {accepted}")


def check_all(*checks: Callable[[], object]) -> None:
    """Makes independent checks; raises the ValueError of one, or an InputError with the lines of several."""
    errors = []
    for check in checks:
        try:
            check()
        except ValueError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise InputError(*(line for error in errors for line in _lines_of(error)))


def _lines_of(error: ValueError) -> list[str]:
    return [*error.args] if isinstance(error, InputError) else [str(error)]


def is_name(text: str) -> bool:
    """Returns whether a text can be a name, which needs no escaping in files, columns, labels and ids.

    >>> [is_name(text) for text in ("S1", "rate-0_1", "9x", "_x", "a/b", "a b", "..", "", "1e5", "NA", "con")]
    [True, True, True, False, False, False, False, False, False, False, False]
    """
    return _NAME.fullmatch(text) is not None and not (_VALUE.fullmatch(text) or _DEVICE.fullmatch(text))


def _named(text: str) -> str:
    if not is_name(text):
        raise ValueError(f"accepted: {_NAME_RULE}")
    return text


def _in_one_line(text: str) -> str:
    if _BREAK.search(text):
        raise ValueError("accepted: text in one line, without tabs")
    return text


Name = Annotated[str, AfterValidator(_named)]
Line = Annotated[str, AfterValidator(_in_one_line)]  # free text that labels something


def check_file_name(path: Path, what: str) -> None:
    """Refuses a file by an InputError if `what`, say "results are", cannot be named after it."""
    if not is_name(path.stem):
        shown = str(path) if str(path).isprintable() else json.dumps(str(path))
        raise InputError(f"{shown}: {what} named after the file; accepted: {_NAME_RULE}.")


def read_toml(path: Path) -> dict[str, Any]:
    """Reads a TOML file; one that cannot be read, is too large or nested too deeply raises an InputError."""
    try:
        if path.exists() and not path.is_file():  # a pipe might never end
            raise OSError(0, "it is not a file")
        if path.stat().st_size > _LARGEST_FILE:
            raise OSError(0, f"it is larger than {_LARGEST_FILE:,} bytes")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason}.") from error
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}.") from error
    except RecursionError:
        raise InputError(f"{path}: {_TOO_DEEP}.") from None
    except ValueError as error:  # Python refuses to read such a number
        raise InputError(f"{path}: a number has {_TOO_LONG}.") from error
    _check_texts(data, str(path))
    return data


def whole_number(text: str, option: str, low: int, high: int) -> int:
    """Returns the number from `low` to `high` that an option gives; other texts raise an InputError."""
    if not (text.isascii() and text.isdecimal() and len(text) <= len(str(high)) and low <= int(text) <= high):
        raise InputError(f"{option} {shortened(text)}: accepted: a whole number from {low} to {high:,}.")
    return int(text)


def shortened(text: str, longest: int = _LONGEST_VALUE) -> str:
    r"""Returns a text as messages repeat it: cut if it is long, quoted if it is not printable.

    >>> shortened("abc"), shortened("abcdef", longest=5), shortened("a\tb")
    ('abc', 'ab...', '"a\\tb"')
    """
    text = text if len(text) <= longest else f"{text[: longest - 3]}..."
    return text if text.isprintable() else json.dumps(text)


def _check_texts(value: object, source: str, key: str = "", depth: int = 1) -> None:
    """Refuses deep nesting, more digits than Python writes, and characters that take over a terminal."""
    if depth > _DEEPEST:
        raise InputError(f"{source}: {_TOO_DEEP}.")
    if isinstance(value, int) and abs(value) >= _TOO_LARGE:  # as hexadecimal, Python reads it
        raise InputError(f"{source}: {key}: {_TOO_LONG}.")
    if isinstance(value, str) and _CONTROL.search(value):
        shown = shortened(value, _LONGEST_NAME)
        raise InputError(f"{source}: {key} = {shown}: accepted: text without control characters.")
    if isinstance(value, Mapping):
        for name, item in value.items():
            where = f"{key}.{shortened(str(name), _LONGEST_NAME)}".removeprefix(".")
            if _CONTROL.search(str(name)) or _BREAK.search(str(name)):
                raise InputError(f"{source}: the key {where}: accepted: text without control characters.")
            _check_texts(item, source, where, depth + 1)
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            _check_texts(item, source, f"{key}.{i}", depth + 1)


def override(data: Mapping[str, object], overrides: Mapping[str, object], source: str) -> dict[str, Any]:
    """Returns a copy of nested tables with some values replaced, by dotted key: `{"grid.start": [8, 6]}`.

    A key that passes through a value that is not a table, or through too many tables, raises an InputError.
    """
    result = json.loads(json.dumps(data, default=str))
    for dotted, value in overrides.items():
        *tables, key = dotted.split(".")
        if len(tables) >= _DEEPEST:
            raise InputError(f"{source}: the key {shortened(dotted)}: {_TOO_DEEP}.")
        table = result
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise InputError(f"{source}: cannot set {dotted}: {name} is a value, not a table.")
        table[key] = value
    return dict(result)


def parse(cls: type[TableT], data: Mapping[str, object], source: str, **given: object) -> TableT:
    """Checks tables, as read from TOML, and returns them as an object of a class.

    Values in `given` must not be in the tables. Mistakes raise an InputError that names the source, which is
    the tables' file, the key, its value and what is accepted.
    """
    for key in given:
        if key in data:
            unknown_name(source, "key", key, cls.model_fields.keys() - given.keys())
    _check_texts(data, source)
    try:
        # From JSON, because the strict validation of Python objects refuses a list in place of a tuple.
        return cls.model_validate_json(json.dumps({**data, **given}, default=str))
    except ValidationError as error:
        errors = _first_of_each_value(error.errors(), {**data, **given})
        lines = (line for details in errors for line in _lines(cls, details, source, given))
        raise InputError(*lines) from None


def _first_of_each_value(errors: Iterable[ErrorDetails], data: object) -> list[ErrorDetails]:
    """Returns the first error of each value; each alternative of a type makes one.

    Unknown keys come first: a misspelt key is also reported as missing, which is left out.
    """
    first: dict[tuple[int | str, ...], ErrorDetails] = {}
    for error in sorted(errors, key=lambda details: details["type"] != "extra_forbidden"):
        location, value, is_missing = error["loc"], data, error["type"] == "missing"
        for depth, key in enumerate(error["loc"]):
            try:
                value = value[key]  # type: ignore[index]
            except (LookupError, TypeError):  # a missing key, or the name of an alternative
                location = error["loc"][: depth + is_missing]
                break
        misspelt = [other["loc"][:-1] for other in first.values() if other["type"] == "extra_forbidden"]
        if not (is_missing and error["loc"][:-1] in misspelt):
            first.setdefault(location, error)
    return [*first.values()]


def _lines(cls: type[Table], error: ErrorDetails, source: str, given: Iterable[str]) -> list[str]:
    *tables, key = (shortened(str(part), _LONGEST_NAME) for part in error["loc"] or [""])
    if error["type"] == "extra_forbidden":
        *location, name = error["loc"]
        where = f"{source}: [{'.'.join(tables)}]" if tables else source
        return [_unknown(where, "key", str(name), set(_accepted(cls, location)) - set(given))]
    key = ".".join([*tables, key])
    if error["type"] == "missing":
        return [f"{source}: the key {key} is missing."]
    where = f"{key} = {shortened(json.dumps(error['input'], default=str))}: " if key else ""
    return [f"{source}: {where}{reason}." for reason in _reasons(error)]


def unknown_name(source: str, kind: str, name: str, accepted: Iterable[str], otherwise: str = "") -> NoReturn:
    """Refuses a name by an InputError that lists the accepted names, and what is accepted otherwise."""
    raise InputError(_unknown(source, kind, name, accepted, otherwise))


def _unknown(source: str, kind: str, name: str, accepted: Iterable[str], otherwise: str = "") -> str:
    accepted = sorted(accepted)
    message = f"{source}: unknown {kind} {shortened(name, _LONGEST_NAME)}{guess(name, accepted)}; accepted: "
    last = f", or {otherwise}" if otherwise else ""
    room = max(_LONGEST_MESSAGE - len(message) - len(last) - 1, _SHORTEST_LIST)
    return f"{message}{shortened(', '.join(accepted), room)}{last}."


def guess(name: str, accepted: Iterable[str]) -> str:
    """Returns a question with the accepted name that is most like another one; empty if none is like it."""
    nearest = difflib.get_close_matches(name[:_LONGEST_NAME], accepted, n=1, cutoff=0.6)
    return f" (did you mean {nearest[0]}?)" if nearest else ""


def _reasons(error: ErrorDetails) -> list[str]:
    details = error.get("ctx", {})
    match error["type"]:
        case "too_short":
            return [f"accepted: at least {details['min_length']} items"]
        case "too_long":
            return [f"accepted: at most {details['max_length']} items"]
        case "union_tag_not_found":
            return ["accepted: a table with a key kind"]
        case "model_type" | "model_attributes_type" | "dict_type":
            return ["accepted: a table"]
        case "value_error":
            messages = _lines_of(details["error"])
        case _:
            messages = [error["msg"]]
    return [f"{message[:1].lower()}{message[1:]}" for message in messages]


def _accepted(annotation: Any, location: Iterable[int | str]) -> list[str]:
    """Returns the keys that a table accepts, by its location in nested tables."""
    for part in location:
        if get_origin(annotation) in (dict, Mapping):  # tables that users name
            annotation = get_args(annotation)[1]
        elif get_origin(annotation) is tuple:  # tables in a list
            annotation = get_args(annotation)[0]
        elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
            annotation = annotation.model_fields[str(part)].annotation
        else:  # a union of tables that differ in their kind
            annotation = next(table for table in get_args(annotation) if part in _tags(table))
        annotation = _bare(annotation)
    return list(annotation.model_fields)


def _tags(annotation: Any) -> Sequence[Any]:
    tags = [tag.tag for tag in getattr(annotation, "__metadata__", ()) if isinstance(tag, Tag)]
    return tags or get_args(_bare(annotation).model_fields["kind"].annotation)


def _bare(annotation: Any) -> Any:
    if get_origin(annotation) is Annotated:
        return _bare(get_args(annotation)[0])
    others = [alternative for alternative in get_args(annotation) if alternative is not type(None)]
    return _bare(others[0]) if len(others) == 1 and type(None) in get_args(annotation) else annotation
