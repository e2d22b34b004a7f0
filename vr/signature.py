"""From Python annotations to typed values that travel: `Annotated[float, Unit("m"), Range(0, 1), "far"]`.

Mistakes of an author are `TypeError`s whose sentence names the class, the command and the parameter.
"""

from __future__ import annotations

import dataclasses
import inspect
import types
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, Union, cast, get_args, get_origin, get_type_hints

import msgspec

from robotree.vr.arguments import check_argument
from robotree.vr.description import CommandSpec, Effect, FieldSpec, ParameterType
from robotree.vr.errors import BadArgument
from robotree.vr.units import Range, Unit

_SIMPLE: dict[object, ParameterType] = {float: "float", int: "int", bool: "bool", str: "str"}
_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


def spec_of(function: Callable[..., Any], effect: Effect) -> CommandSpec:
    """Return how a method looks to its callers.

    Args:
        function: the undecorated method, `self` first.
        effect: what a repetition does.

    Raises:
        TypeError: an annotation is missing, or of a type that cannot travel.
    """
    if inspect.iscoroutinefunction(function) or inspect.isgeneratorfunction(function):
        raise TypeError(f"{function.__qualname__}: a command is a plain function; it may block as it likes")
    hints = _hints(function)
    parameters = list(inspect.signature(function).parameters.values())[1:]
    return CommandSpec(
        name=function.__name__,
        doc=inspect.cleandoc(function.__doc__ or ""),
        effect=effect,
        parameters=tuple(_parameter(function, parameter, hints) for parameter in parameters),
        result=tuple(_result(hints.get("return", types.NoneType), function.__qualname__)),
    )


def returned_by(function: Callable[..., Any]) -> Any:
    """Return the annotation of a command's result; `Any` where there is none.

    Raises:
        TypeError: it names something that is not there.
    """
    return _hints(function).get("return", Any)


def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    try:
        return get_type_hints(function, include_extras=True)
    except NameError as error:
        raise TypeError(
            f"{function.__qualname__}: {error}; define it in the file, outside of functions"
        ) from None


def _parameter(
    function: Callable[..., Any], parameter: inspect.Parameter, hints: dict[str, Any]
) -> FieldSpec:
    where = f"{function.__qualname__}: parameter {parameter.name!r}"
    if parameter.kind not in _NAMED:
        raise TypeError(f"{where}: a command takes named parameters only")
    if parameter.name not in hints:
        raise TypeError(f"{where} needs a type: float, int, bool, str or Literal of texts")
    field = _field(parameter.name, hints[parameter.name], where)
    if parameter.default is inspect.Parameter.empty:
        return field
    field = msgspec.structs.replace(field, required=False, default=parameter.default)
    try:
        check_argument(field, parameter.default, command=function.__qualname__)
    except BadArgument as error:
        raise TypeError(f"default of {error}") from None
    return field


def _field(name: str, annotation: Any, where: str, other: str = "") -> FieldSpec:
    extras: tuple[Any, ...] = ()
    if get_origin(annotation) is Annotated:
        annotation, *rest = get_args(annotation)
        extras = tuple(rest)
    annotation, inner = _without_none(annotation)
    extras = inner + extras
    kind, choices = _type(annotation, where, other)
    limits = _last(Range, extras, Range())
    if kind not in {"float", "int"} and any(isinstance(extra, Range | Unit) for extra in extras):
        raise TypeError(f"{where}: only numbers have a unit or a range")
    return FieldSpec(
        name=name,
        type=kind,
        unit=_last(Unit, extras, Unit("")).symbol,
        lower=limits.lower,
        upper=limits.upper,
        choices=choices,
        doc=inspect.cleandoc(_last(str, extras, "")),
    )


def _last(kind: type[Any], extras: tuple[Any, ...], otherwise: Any) -> Any:
    return next((extra for extra in reversed(extras) if isinstance(extra, kind)), otherwise)


def _without_none(annotation: Any) -> tuple[Any, tuple[Any, ...]]:
    """Unwrap `X | None` and an `Annotated` inside of it."""
    if get_origin(annotation) in {Union, types.UnionType}:
        inner = [part for part in get_args(annotation) if part is not types.NoneType]
        if len(inner) == 1:
            annotation = inner[0]
    if get_origin(annotation) is Annotated:
        annotation, *extras = get_args(annotation)
        return annotation, tuple(extras)
    return annotation, ()


def _type(annotation: Any, where: str, other: str) -> tuple[ParameterType, tuple[str, ...]]:
    if get_origin(annotation) is Literal:
        choices = get_args(annotation)
        if all(isinstance(choice, str) for choice in choices):
            return "choice", choices
    elif annotation in _SIMPLE:
        return _SIMPLE[annotation], ()
    raise TypeError(f"{where} cannot be {annotation!r}: use float, int, bool, str or Literal of texts{other}")


def _result(annotation: Any, where: str) -> Iterator[FieldSpec]:
    if annotation is None or annotation is types.NoneType:
        return
    if inspect.isclass(annotation) and _has_parts(cls := cast("type[Any]", annotation)):
        for name, part in get_type_hints(cls, include_extras=True).items():
            if not name.startswith("_"):
                yield _field(name, part, f"{where}: its result's {name!r}")
        return
    if annotation is not Any:
        yield _field("", annotation, f"{where}: its result", ", or a dataclass of such")


def _has_parts(cls: type[Any]) -> bool:
    return issubclass(cls, msgspec.Struct) or dataclasses.is_dataclass(cls)
