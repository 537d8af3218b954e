"""Turns TOML tables into checked values, and mistakes into messages of one sentence.

All input is checked here: scenarios, experiments and algorithm settings are subclasses of `Table`,
and `parse` reads them.
"""

import difflib
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, NoReturn, Self, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

_MAX_LENGTH = 300  # characters
_MAX_MESSAGES = 10
_MAX_NAME = 60  # characters of a name that is compared with others

_NAME_RULE = (
    "a name of at most 60 letters, digits, _ and -, the first a letter or digit; "
    "no number, true, false or NA"
)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")
# Names that pandas or R would read as numbers, booleans or missing values.
_VALUE = re.compile(r"[0-9]+(e-?[0-9]+)?|inf|infinity|na|nan|none|null|true|false", re.IGNORECASE)


class InputError(ValueError):
    """Mistakes in the user's input, one or more, each a line that can be shown as it is."""

    def __init__(self, *messages: object) -> None:
        # AsyncVectorEnv raises an error again with the error as its argument.
        lines = [*dict.fromkeys(map(_as_line, map(str, messages)))]
        n_more = len(lines) - _MAX_MESSAGES
        super().__init__(*lines[:_MAX_MESSAGES], *[f"and {n_more:,} more."] * (n_more > 0))

    def __str__(self) -> str:
        return "\n".join(self.args)


def _as_line(message: str) -> str:
    line = " ".join("".join(c if c.isprintable() or c.isspace() else "?" for c in message).split())
    if len(line) > _MAX_LENGTH:
        line = f"{line[: _MAX_LENGTH // 2 - 5]} ... {line[-_MAX_LENGTH // 2 :]}"
    return line


class Table(BaseModel):
    """A frozen table of named values. It refuses unknown keys, wrong types, NaN and infinity."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    # Cached properties are neither compared nor copied nor pickled.
    def _given(self) -> dict[str, object]:
        return {key: self.__dict__[key] for key in type(self).model_fields}

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Table)
            and type(self) is type(other)
            and self._given() == other._given()
        )

    def __hash__(self) -> int:
        values = self._given().values()
        return hash(
            tuple(tuple(value.items()) if isinstance(value, dict) else value for value in values)
        )

    def __copy__(self) -> Self:  # for `model_copy`, which may change fields
        copied = super().__copy__()
        object.__setattr__(copied, "__dict__", self._given())
        return copied

    def __getstate__(self) -> dict[Any, Any]:
        return super().__getstate__() | {"__dict__": self._given()}


TableT = TypeVar("TableT", bound=Table)
ValuesT = TypeVar("ValuesT", bound=tuple[object, ...])


def require(is_met: bool, found: str, accepted: str) -> None:
    """Raises a ValueError, to which `parse` adds file and key, if a condition is not met."""
    if not is_met:
        raise ValueError(f"{found}: accepted: {accepted}")


def check_all(*checks: Callable[[], object]) -> None:
    """Makes independent checks; raises one's ValueError, or an InputError with several lines."""
    errors = []
    for check in checks:
        try:
            check()
        except ValueError as error:
            errors.append(error)
    if len(errors) == 1:
        raise errors[0]
    if errors:
        raise InputError(*(line for error in errors for line in error.args))


def is_name(text: str) -> bool:
    """Returns whether a text can be a name, without escaping in files, columns, labels and ids.

    >>> [is_name(text) for text in ("S1", "rate-0_1", "9x", "_x", "a/b", "a b", "..", "", "1e5")]
    [True, True, True, False, False, False, False, False, False]
    """
    return _NAME.fullmatch(text) is not None and not _VALUE.fullmatch(text)


def accepted_if(is_accepted: Callable[[str], bool], accepted: str) -> AfterValidator:
    """Returns a validator that refuses texts by a ValueError, unless a condition is met."""

    def validate(text: str) -> str:
        if not is_accepted(text):
            raise ValueError(f"accepted: {accepted}")
        return text

    return AfterValidator(validate)


def distinct(values: ValuesT, where: str = "") -> ValuesT:
    """Returns the values; raises a ValueError if one of them comes twice."""
    for value in values:
        found = f"{where}{shortened(str(value))} is named twice"
        require(values.count(value) == 1, found, "each once")
    return values


Name = Annotated[str, accepted_if(is_name, _NAME_RULE)]
Names = Annotated[tuple[str, ...], AfterValidator(distinct)]
_IN_ONE_LINE = accepted_if(str.isprintable, "text in one line, without control characters")
Line = Annotated[str, _IN_ONE_LINE]
Count = Annotated[int, Field(ge=1, le=10**9)]
Share = Annotated[float, Field(ge=0, le=1)]
# What readers see: something that labels, and paragraphs. Empty ones say that there is none.
Label = Annotated[str, Field(max_length=200), _IN_ONE_LINE]
Text = Annotated[
    str,
    Field(max_length=10_000),
    accepted_if(
        lambda text: "".join(text.split()).isprintable(), "text without control characters"
    ),
]


def check_file_name(path: Path, what: str) -> None:
    """Refuses a file by an InputError if `what`, say "results are", cannot be named after it."""
    if not is_name(path.stem):
        raise InputError(f"{path}: {what} named after the file; accepted: {_NAME_RULE}.")


def read_toml(path: Path) -> dict[str, Any]:
    """Reads a TOML file; one that cannot be read raises an InputError."""
    if path.exists() and not path.is_file():  # it may be a pipe that never ends
        raise InputError(f"{path}: cannot be read: it is not a regular file.")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        json.dumps(data, default=str)  # as `parse` does
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}.") from error
    except (
        ValueError,
        RecursionError,
    ) as error:  # no UTF-8, no TOML, nested too deeply, too many digits
        raise InputError(f"{path}: not valid TOML: {error}.") from error
    return data


def whole_number(text: str, option: str, low: int, high: int) -> int:
    """Returns an option's number, from `low` to `high`; other texts raise an InputError."""
    if not (
        text.isascii()
        and text.isdecimal()
        and len(text) <= len(str(high))
        and low <= int(text) <= high
    ):
        raise InputError(
            f"{option} {shortened(text)}: accepted: a whole number from {low} to {high:,}."
        )
    return int(text)


def shortened(text: str, longest: int = 80) -> str:
    r"""Returns a text as messages repeat it: cut if it is long, quoted if it is not printable.

    >>> shortened("abc"), shortened("abcdef", longest=5), shortened("a\tb")
    ('abc', 'ab...', '"a\\tb"')
    """
    text = text if len(text) <= longest else f"{text[: longest - 3]}..."
    return text if text.isprintable() else json.dumps(text)


def override(
    data: Mapping[str, object], overrides: Mapping[str, object], source: str
) -> dict[str, Any]:
    """Returns a copy of nested tables with values replaced by dotted key: `{"grid.start": [8, 6]}`.

    A key that passes through a value that is not a table raises an InputError.
    """
    result, changes = json.loads(json.dumps([dict(data), dict(overrides)], default=str))
    for dotted, value in changes.items():
        *tables, key = dotted.split(".")
        table = result
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise InputError(f"{source}: cannot set {dotted}: {name} is a value, not a table.")
        table[key] = value
    return dict(result)


def parse(cls: type[TableT], data: Mapping[str, object], source: str, **given: object) -> TableT:
    """Checks tables, as read from TOML, and returns them as an object of a class.

    Values in `given` must not be in the tables. Mistakes raise an InputError that names the source,
    which is the tables' file, the key, its value and what is accepted.
    """
    for key in given:
        if key in data:
            unknown_name(source, "key", key, cls.model_fields.keys() - given.keys())
    try:
        # From JSON, because the strict validation of Python objects refuses a list in place of a
        # tuple.
        return cls.model_validate_json(json.dumps({**data, **given}, default=str))
    except ValidationError as error:
        lines = (_lines(cls, details, source, given) for details in error.errors())
        raise InputError(*chain.from_iterable(lines)) from None
    except RecursionError:  # after an `override`
        raise InputError(f"{source}: nested too deeply.") from None


def _lines(cls: type[Table], error: ErrorDetails, source: str, given: Iterable[str]) -> list[str]:
    *tables, key = (shortened(str(part), _MAX_NAME) for part in error["loc"] or [""])
    if error["type"] == "extra_forbidden":
        *location, name = error["loc"]
        where = f"{source}: [{'.'.join(tables)}]" if tables else source
        return [_unknown(where, "key", str(name), _accepted(cls, location) - {name, *given})]
    key = ".".join([*tables, key])
    if error["type"] == "missing":
        return [f"{source}: the key {key} is missing."]
    where = f"{key} = {shortened(json.dumps(error['input'], default=str))}: " if key else ""
    reasons = [*error["ctx"]["error"].args] if error["type"] == "value_error" else [error["msg"]]
    return [f"{source}: {where}{reason[:1].lower()}{reason[1:]}." for reason in reasons]


def unknown_name(
    source: str, kind: str, name: str, accepted: Iterable[str], otherwise: str = ""
) -> NoReturn:
    """Refuses a name by an InputError that lists the accepted names, and what else is."""
    raise InputError(_unknown(source, kind, name, accepted, otherwise))


def _unknown(
    source: str, kind: str, name: str, accepted: Iterable[str], otherwise: str = ""
) -> str:
    accepted = sorted(accepted)
    message = (
        f"{source}: unknown {kind} {shortened(name, _MAX_NAME)}{guess(name, accepted)}; accepted: "
    )
    last = f", or {otherwise}" if otherwise else ""
    room = max(_MAX_LENGTH - len(message) - len(last) - 1, 40)  # characters
    return f"{message}{shortened(', '.join(accepted), room)}{last}."


def guess(name: str, accepted: Iterable[str]) -> str:
    """Returns a question that suggests the accepted name most like another, if one is close."""
    lower = {other.lower(): other for other in accepted}
    nearest = difflib.get_close_matches(name[:_MAX_NAME].lower(), lower, n=1, cutoff=0.6)
    return f" (did you mean {lower[nearest[0]]}?)" if nearest else ""


def _accepted(cls: type[BaseModel], location: Iterable[int | str]) -> set[str]:
    """Returns the keys of the table at a location; of alternatives, the keys of all."""
    tables = [cls]
    for key in (
        location
    ):  # of a table, or else an index, a name that users give, or that of an alternative
        tables = [
            inner
            for table in tables
            if key in table.model_fields
            for inner in _tables(table.model_fields[key].annotation)
        ] or tables
    return {key for table in tables for key in table.model_fields}


def _tables(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for argument in get_args(annotation) for table in _tables(argument)]
