"""Turns TOML tables into checked values, and mistakes into messages of one sentence.

All input is checked here: scenarios, experiments and algorithm settings are subclasses of `Table`,
and `parse` reads them.
"""

import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, NoReturn, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)
from pydantic_core import ErrorDetails

_NAME_RULE: Final = (
    "a name of at most 60 letters, digits, _ and -, the first a letter or digit, that is not a number, true, "
    "false or NA"
)
_LONGEST_VALUE: Final = 200  # characters of a value that a message repeats; that of a table may be a page
_LONGEST_KEY: Final = 60
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")
# Names that readers of a CSV file, which pandas or R infer from its texts, take for values of another type.
_VALUE: Final = re.compile(r"[0-9]+(e-?[0-9]+)?|inf|infinity|na|nan|none|null|true|false", re.IGNORECASE)
# Control characters, those of lines and writing direction among them, and halves of characters.
_CONTROL: Final = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
_BREAK: Final = re.compile(r"[\n\t]")


class InputError(ValueError):
    """A mistake in the user's input; the message is a sentence that can be shown as it is."""


class Table(BaseModel):
    """A frozen table of named values. It refuses unknown keys, wrong types, NaN and infinity."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    # Keys that a table got later. They are not written while they have their defaults, so that what was
    # written before, and the digests of runs, stay the same.
    later: ClassVar[frozenset[str]] = frozenset()

    # What a table has cached is neither compared nor pickled.

    def __eq__(self, other: object) -> bool:
        """Compares types and values."""
        return type(self) is type(other) and all(
            getattr(self, key) == getattr(other, key) for key in type(self).model_fields
        )

    def __hash__(self) -> int:
        """Hashes the values."""
        values = (getattr(self, key) for key in type(self).model_fields)
        return hash(tuple(tuple(value.items()) if isinstance(value, dict) else value for value in values))

    def __getstate__(self) -> dict[Any, Any]:
        """Returns what is pickled."""
        state = super().__getstate__()
        fields = type(self).model_fields
        return state | {"__dict__": {key: v for key, v in state["__dict__"].items() if key in fields}}

    @model_serializer(mode="wrap")
    def _without_later_defaults(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = handler(self)
        for key in self.later & written.keys():
            if getattr(self, key) == type(self).model_fields[key].get_default(call_default_factory=True):
                del written[key]
        return written


TableT = TypeVar("TableT", bound=Table)


def is_name(text: str) -> bool:
    """Returns whether a text can be a name: of an experiment, arm, scenario, reading, axis or its condition.

    Names become parts of files, columns, labels and Gymnasium ids, and so need no escaping anywhere.

    >>> [is_name(text) for text in ("S1", "rate-0_1", "9x", "_x", "a/b", "a b", "..", "", "1e5", "NA")]
    [True, True, True, False, False, False, False, False, False, False]
    """
    return _NAME.fullmatch(text) is not None and _VALUE.fullmatch(text) is None


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
    """Checks that something can be named after its file.

    Args:
      path: Of the file.
      what: That is named, for the message, for example "results are".

    Raises:
      InputError: It cannot.
    """
    if not is_name(path.stem):
        shown = str(path) if str(path).isprintable() else json.dumps(str(path))
        raise InputError(f"{shown}: {what} named after the file; accepted: {_NAME_RULE}.")


def in_either_case(names: Iterable[str]) -> tuple[str, str] | None:
    """Returns two names that differ in case alone, and so share files on some systems; None if none do."""
    met: dict[str, str] = {}
    for name in names:
        other = met.setdefault(name.lower(), name)
        if other != name:
            return other, name
    return None


def read_toml(path: Path) -> dict[str, Any]:
    """Reads a TOML file.

    Raises:
      InputError: The file cannot be read, or is not TOML.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason}.") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}.") from error
    _check_texts(data, str(path))
    return data


def _check_texts(value: object, source: str, key: str = "") -> None:
    """Checks that keys and texts have no control characters, which could take over a terminal.

    Raises:
      InputError: One has; the message shows it escaped.
    """
    if isinstance(value, str) and _CONTROL.search(value):
        raise InputError(
            f"{source}: {key} = {_clipped(value)}: accepted: text without control characters other "
            "than line breaks and tabs."
        )
    if isinstance(value, Mapping):
        for name, each in value.items():
            where = f"{key}.{_clipped(str(name))}".removeprefix(".")
            if _CONTROL.search(str(name)) or _BREAK.search(str(name)):
                raise InputError(f"{source}: the key {where}: accepted: text without control characters.")
            _check_texts(each, source, where)
    elif isinstance(value, list | tuple):
        for i, each in enumerate(value):
            _check_texts(each, source, f"{key}.{i}")


def _clipped(text: str) -> str:
    r"""Returns a text as a message repeats it: as it is if it is short and printable, else quoted.

    >>> [_clipped(text) for text in ("a/b", "a\tb")]
    ['a/b', '"a\\tb"']
    >>> _clipped("x" * 61) == '"' + "x" * 60 + '"...'
    True
    """
    if text.isprintable() and len(text) <= _LONGEST_KEY:
        return text
    return f"{json.dumps(text[:_LONGEST_KEY])}{'...' if len(text) > _LONGEST_KEY else ''}"


def override(data: Mapping[str, Any], overrides: Mapping[str, Any], source: str) -> dict[str, Any]:
    """Returns a copy of nested tables with some values replaced.

    Args:
      data: Tables as read from TOML.
      overrides: Dotted key to new value, for example `{"issuer.position": [8, 6]}`.
      source: The origin of `data`, for the message.

    Raises:
      InputError: A key passes through a value that is not a table.
    """
    result = json.loads(json.dumps(data, default=str))
    for dotted, value in overrides.items():
        *tables, key = dotted.split(".")
        table = result
        for name in tables:
            table = table.setdefault(name, {})
            if not isinstance(table, dict):
                raise InputError(f"{source}: cannot set {dotted}: {name} is a value, not a table.")
        table[key] = value
    return dict(result)


def parse(cls: type[TableT], data: Mapping[str, Any], source: str, **given: Any) -> TableT:
    """Checks tables and returns them as a typed object.

    Args:
      cls: Class of the object.
      data: Tables as read from TOML.
      source: The file of `data`, for the message.
      **given: Values that are not in the file; the file must not contain these keys.

    Raises:
      InputError: Names the file, the key, its value and what is accepted.
    """
    for key in given:
        if key in data:
            unknown_name(source, "key", key, cls.model_fields.keys() - given.keys())
    _check_texts(data, source)
    try:
        # From JSON, because the strict validation of Python objects refuses a list in place of a tuple.
        return cls.model_validate_json(json.dumps({**data, **given}, default=str))
    except ValidationError as error:
        # Unknown keys first: a misspelt key is also reported as missing, which says less.
        first = min(error.errors(), key=lambda details: details["type"] != "extra_forbidden")
        key = ".".join(_clipped(str(part)) for part in first["loc"])
        if first["type"] == "extra_forbidden":
            *table, name = first["loc"]
            where = f"{source}: [{'.'.join(_clipped(str(part)) for part in table)}]" if table else source
            unknown_name(where, "key", str(name), set(_accepted(cls, table)) - given.keys())
        if first["type"] == "missing":
            raise InputError(f"{source}: the key {key} is missing.") from None
        value = json.dumps(first["input"])
        value = f" = {value}" if len(value) <= _LONGEST_VALUE else ""
        where = f"{key}{value}: " if key else ""
        raise InputError(f"{source}: {where}{_reason(first)}.") from None


def unknown_name(source: str, kind: str, name: str, accepted: Iterable[str]) -> NoReturn:
    """Refuses a name; the message lists the accepted names and points to the most similar.

    Raises:
      InputError: Always.
    """
    accepted = sorted(accepted)
    nearest = difflib.get_close_matches(name, accepted, n=1, cutoff=0.6)
    hint = f" (did you mean {nearest[0]}?)" if nearest else ""
    raise InputError(f"{source}: unknown {kind} {_clipped(name)}{hint}; accepted: {', '.join(accepted)}.")


def imported(name: str, source: str, kind: str) -> object:
    """Imports what `module:attribute` names.

    Args:
      name: The module and the attribute.
      source: What named it, for the message.
      kind: What it should be, for the message.

    Raises:
      InputError: It cannot be imported.
    """
    module, _, attribute = name.partition(":")
    try:
        found: object = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        raise InputError(f"{source}: {kind} {name} cannot be imported: {error}.") from error
    return found


def _reason(error: ErrorDetails) -> str:
    """Returns why a value is refused, in plain words."""
    details = error.get("ctx", {})
    match error["type"]:
        case "too_short":
            return f"accepted: at least {details['min_length']} items"
        case "too_long":
            return f"accepted: at most {details['max_length']} items"
        case "union_tag_not_found":
            return "accepted: a table with a key kind"
        case "model_type" | "model_attributes_type" | "dict_type":
            return "accepted: a table"
    message = error["msg"].removeprefix("Value error, ")
    return f"{message[:1].lower()}{message[1:]}"


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
            annotation = next(
                table
                for table in get_args(annotation)
                if part in get_args(table.model_fields["kind"].annotation)
            )
        annotation = _bare(annotation)
    return list(annotation.model_fields)


def _bare(annotation: Any) -> Any:
    """Returns a type without metadata, and without None if the value may be missing."""
    if get_origin(annotation) is Annotated:
        return _bare(get_args(annotation)[0])
    others = [each for each in get_args(annotation) if each is not type(None)]
    return _bare(others[0]) if len(others) == 1 and type(None) in get_args(annotation) else annotation
