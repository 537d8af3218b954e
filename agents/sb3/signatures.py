"""Turns the signature of a class into the keys of a table: their types, their defaults, and what they refuse.

A class that passes `**kwargs` on has the arguments of the class above it, too. An argument becomes a key if a
TOML file can hold its value. Where an annotation says nothing, any value that a file can hold is accepted.
"""

import inspect
import json
from collections.abc import Iterable, Mapping, Sequence
from types import SimpleNamespace, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Final,
    Literal,
    NamedTuple,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import (
    BaseModel,
    ConfigDict,
    JsonValue,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from envs.inputs import InputError, Table

_LISTS: Final = (list, Sequence, Iterable)
_TABLES: Final = (dict, Mapping)
_WORDS: Final = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


class ArgumentTable(Table):
    """A table made from a signature; a key that it refuses for a reason gets a sentence."""

    model_config = ConfigDict(protected_namespaces=(), validate_default=True)

    refused: ClassVar[Mapping[str, str]] = {}  # arguments that cannot be set, and why

    @model_validator(mode="before")
    @classmethod
    def _no_key_is_refused(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) else ():
            if key in cls.refused:
                value = json.dumps(data[key], default=str)
                raise ValueError(f"{key} = {value}: cannot be set, because {cls.refused[key]}")
        return data


class Signature(NamedTuple):
    """What a signature says, in the form that `pydantic.create_model` takes."""

    fields: dict[str, Any]  # key to type and default; the default is `...` if there is none
    refused: dict[str, str]  # arguments that cannot be set, and why


def read_signature(
    cls: type, base: type[BaseModel], known: Mapping[str, Any], refused: Mapping[str, str]
) -> Signature:
    """Reads the signature of a class.

    Args:
      cls: The class.
      base: The table that gets the keys. Its own fields are left alone, and so are its methods.
      known: Types of arguments that this project understands, instead of the annotated ones.
      refused: Arguments that this project sets, and why.

    Raises:
      InputError: A value that a file cannot hold is required.
    """
    signature = Signature({}, dict(refused))
    for name, (parameter, namespace) in _parameters(cls).items():
        if name in refused or (name in base.model_fields and name not in known):
            continue
        kind = known[name] if name in known else _kind(_resolved(parameter.annotation, namespace))
        if name.startswith("_"):
            signature.refused[name] = "it is private"
        elif name not in known and hasattr(base, name):
            signature.refused[name] = "its name has another meaning in the settings of this project"
        elif kind is not None:
            signature.fields[name] = _field(kind, parameter.default, name in known)
        elif parameter.default is inspect.Parameter.empty:
            raise InputError(
                f"{cls.__name__} needs the argument {name}; accepted: classes whose required arguments a "
                "TOML file can hold."
            )
        else:
            signature.refused[name] = "its value is a Python object, which a TOML file cannot hold"
    return signature


def lenient(kind: Any) -> Any:
    """Returns a type of tuples that also accepts lists; a file has no others."""
    return Annotated[kind, Strict(False)]


def one_of(words: str) -> WrapValidator:
    """Returns a validator for a union, which says in words what it accepts."""

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise ValueError(f"accepted: {words}") from None

    return WrapValidator(check)


def _parameters(cls: type) -> dict[str, tuple[inspect.Parameter, dict[str, Any]]]:
    """Returns the named arguments of a class, each with the namespace of its annotation."""
    found: dict[str, tuple[inspect.Parameter, dict[str, Any]]] = {}
    for base in cls.__mro__[:-1]:
        if "__init__" not in vars(base):
            continue
        function: Any = inspect.unwrap(vars(base)["__init__"])
        parameters = list(inspect.signature(function).parameters.values())[1:]
        for parameter in parameters:
            if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY):
                found.setdefault(parameter.name, (parameter, function.__globals__))
        if all(parameter.kind is not parameter.VAR_KEYWORD for parameter in parameters):
            break
    return found


def _resolved(annotation: Any, namespace: dict[str, Any]) -> Any:
    """Returns an annotation as types; `Any` if there is none, or if it names what its module has not."""
    if annotation is inspect.Parameter.empty:
        return Any
    holder: Any = SimpleNamespace(__annotations__={"it": annotation})
    try:
        return get_type_hints(holder, namespace)["it"]
    except NameError:
        return Any


def _kind(annotation: Any) -> Any:
    """Returns the part of a type that values in a TOML file can have; None if there is no such part."""
    origin, arguments = get_origin(annotation) or annotation, get_args(annotation)
    if origin is Any:
        return JsonValue
    if origin in _WORDS or origin is Literal:
        return annotation
    if origin is Annotated:
        return _kind(arguments[0])
    if origin in (Union, UnionType):
        kinds = [kind for kind in map(_kind, arguments) if kind is not None]
        if len(kinds) < 2:
            return kinds[0] if kinds else None
        return Annotated[Union[tuple(kinds)], one_of(" or ".join(map(_words, kinds)))]  # noqa: UP007
    if origin is tuple:
        kinds = [argument if argument is ... else _kind(argument) for argument in arguments or (Any, ...)]
        return None if None in kinds else lenient(tuple[tuple(kinds)])  # type: ignore[misc]
    if origin in _LISTS or origin in _TABLES:
        value = _kind(arguments[-1] if arguments else Any)
        if value is None:
            return None
        return list[value] if origin in _LISTS else dict[str, value]  # type: ignore[valid-type]
    return None


def _words(kind: Any) -> str:
    """Returns what values of a type are called."""
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    origin = get_origin(kind)
    if origin is Literal:
        return " or ".join(json.dumps(value) for value in get_args(kind))
    return _WORDS.get(
        kind, "a table" if origin is dict else "a list" if origin in (list, tuple) else "a value"
    )


def _field(kind: Any, default: Any, is_known: bool) -> tuple[Any, Any]:
    """Returns the type and the default of a key.

    A default that its annotation forbids widens the type. The default None stands for one that a file cannot
    hold. A key that this project understands is required if its default is not of its type.
    """
    if default is inspect.Parameter.empty:
        return kind, ...
    try:
        TypeAdapter(kind, config=Table.model_config).validate_python(default)
    except ValidationError:
        if is_known:
            return kind, ...
        try:
            TypeAdapter(JsonValue, config=Table.model_config).validate_python(default)
        except ValidationError:
            default = None
        return (kind if default is None else JsonValue) | None, default
    return kind, default
