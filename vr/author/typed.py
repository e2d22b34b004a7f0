"""From an annotation to the description of a value: `Annotated[float, Unit("m"), Range(0, 1), "far"]`.

Numbers, truth values and texts; choices (Literal or Enum of texts); lists, tuples and dictionaries with texts
as keys; records (a dataclass, a TypedDict or a Struct); any of them or None; bytes as a result. A unit or a
range of a list or a dictionary is that of its numbers. Mistakes of an author are `TypeError`s.
"""

from __future__ import annotations

import collections.abc
import dataclasses
import inspect
import types
from enum import Enum
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    NotRequired,
    Required,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

import msgspec

from robotree.vr.base.description import FieldSpec, ParameterType
from robotree.vr.base.plain import to_plain
from robotree.vr.base.units import Range, Unit

USABLE = (
    "float, int, bool, str, a Literal or Enum of texts, list[…], tuple[…], dict[str, …], a dataclass or "
    "TypedDict, or one of these | None"
)
_SIMPLE: dict[object, ParameterType] = {float: "float", int: "int", bool: "bool", str: "str", bytes: "bytes"}
_SETS = (set, frozenset, collections.abc.Set)
_LISTS = frozenset({list, collections.abc.Sequence})
_DICTS = frozenset({dict, collections.abc.Mapping})
_PLAIN, _ANY = Unit(""), Range()


class Part(NamedTuple):
    """One value of a record."""

    annotation: Any
    required: bool = True
    default: Any = None


def field_of(
    name: str,
    annotation: Any,
    where: str,
    *,
    above: tuple[type[Any], ...] = (),
    measures: tuple[Range | Unit, ...] = (),
) -> FieldSpec:
    """Return how a value of a type is described.

    Args:
        name: of the value.
        annotation: its type.
        where: for messages: `Arm.go_to: parameter 'x'`.
        above: the records in which it lies.
        measures: units and ranges of the list in which it lies.

    Raises:
        TypeError: such a value cannot travel.
    """
    annotation, extras, nullable = unwrapped(annotation)
    own = tuple(extra for extra in extras if isinstance(extra, Range | Unit))
    kind, items, choices = _content(annotation, where, above, (*measures, *own))
    if kind not in {"float", "int", "list", "tuple", "dict"} and (own or measures):
        raise TypeError(f"{where}: only numbers have a unit or a range")
    unit, limits = "", _ANY
    if kind in {"float", "int"}:
        unit = _last(Unit, (*measures, *own), _PLAIN).symbol
        limits = _last(Range, (*measures, *own), _ANY)
    return FieldSpec(
        name=name,
        type=kind,
        unit=unit,
        lower=limits.lower,
        upper=limits.upper,
        choices=choices,
        nullable=nullable,
        items=items,
        doc=inspect.cleandoc(_last(str, extras, "")),
    )


def parts_of(cls: type[Any], where: str) -> dict[str, Part]:
    """Return the values of a record by name; empty: the class is none.

    Raises:
        TypeError: an annotation names something that is not there.
    """
    if not is_record(cls):
        return {}
    hints = hints_of(cls, f"{where}: {cls.__name__}")
    if is_typeddict(cls):
        return {name: _key(cls, name, hint) for name, hint in hints.items()}
    if issubclass(cls, msgspec.Struct):
        structs = msgspec.structs.fields(cls)
        return {
            field.name: Part(hints[field.name], field.required, _default(field.default)) for field in structs
        }
    return {
        field.name: Part(
            hints[field.name],
            field.default is field.default_factory is dataclasses.MISSING,
            _default(field.default),
        )
        for field in dataclasses.fields(cls)
        if field.init
    }


def hints_of(thing: Any, where: str) -> dict[str, Any]:
    """Return the annotations of a class or a function, evaluated.

    Raises:
        TypeError: one names something that is not there.
    """
    try:
        return get_type_hints(thing, include_extras=True)
    except NameError as error:
        raise TypeError(f"{where}: {error}; define it in the file, outside of functions") from None


def is_record(annotation: Any) -> bool:
    """Whether a type is a record: a dataclass, a TypedDict or a Struct."""
    if not isinstance(annotation, type):
        return False
    cls = cast("type[Any]", annotation)
    return is_typeddict(cls) or issubclass(cls, msgspec.Struct) or dataclasses.is_dataclass(cls)


def needs_building(annotation: Any) -> bool:
    """Whether an author's code takes a value in another form than that in which it travels.

    Numbers, texts and lists of them are taken as they travel; an Enum, a tuple or a record is built.
    """
    if isinstance(annotation, type) and get_origin(annotation) is None:
        if is_typeddict(annotation):
            return any(needs_building(part.annotation) for part in parts_of(annotation, "").values())
        return issubclass(annotation, Enum) or is_record(annotation)
    origin = get_origin(annotation)
    return origin is tuple or (origin is not Literal and any(map(needs_building, get_args(annotation))))


def _content(
    annotation: Any, where: str, above: tuple[type[Any], ...], measures: tuple[Range | Unit, ...]
) -> tuple[ParameterType, tuple[FieldSpec, ...], tuple[str, ...]]:
    """Return the kind of a type, what is in it, and its choices."""
    origin, args = get_origin(annotation), get_args(annotation)
    if annotation in _SIMPLE:
        return _SIMPLE[annotation], (), ()
    if origin is Literal and all(isinstance(choice, str) for choice in args):
        return "choice", (), args
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return "choice", (), _members(annotation, where)
    if repeated := _repeated(origin, args):
        item = args[1] if repeated == "dict" else args[0]
        return repeated, (field_of("", item, f"{where}: a value of it", above=above, measures=measures),), ()
    if origin is tuple and args:
        items = (
            field_of("", argument, f"{where}: value {index}", above=above, measures=measures)
            for index, argument in enumerate(args)
        )
        return "tuple", tuple(items), ()
    if is_record(annotation):
        return "record", _record(cast("type[Any]", annotation), where, above), ()
    if annotation in {*_LISTS, *_DICTS, tuple}:
        example = "dict[str, float]" if annotation in _DICTS else "list[float]"
        raise TypeError(f"{where} does not say what is in it: write for example {example}")
    raise TypeError(f"{where} cannot be {_spelled(annotation)}: {_instead(annotation)}")


def _repeated(origin: Any, args: tuple[Any, ...]) -> Literal["list", "dict"] | None:
    """Return what holds any number of values of one type; None: the type is no such."""
    if origin in _LISTS or (origin is tuple and args[1:] == (...,)):
        return "list"
    return "dict" if origin in _DICTS and args[0] is str else None


def _record(cls: type[Any], where: str, above: tuple[type[Any], ...]) -> tuple[FieldSpec, ...]:
    if cls in above:
        raise TypeError(f"{where} contains itself: a {cls.__name__} cannot lie in a {cls.__name__}")
    fields: list[FieldSpec] = []
    for name, part in parts_of(cls, where).items():
        field = field_of(name, part.annotation, f"{where}: its {name!r}", above=(*above, cls))
        if not part.required:
            field = msgspec.structs.replace(field, required=False, default=part.default)
        fields.append(field)
    return tuple(fields)


def _members(kind: type[Enum], where: str) -> tuple[str, ...]:
    for member in kind:
        if not isinstance(member.value, str):
            mistake = f"{kind.__name__}.{member.name} is {member.value!r}"
            raise TypeError(f'{where}: {mistake}; write a text: {member.name} = "{member.name.lower()}"')
    return tuple(member.value for member in kind)


def unwrapped(annotation: Any) -> tuple[Any, tuple[Any, ...], bool]:
    """Unwrap `Annotated` and `X | None`; return the type, its annotations, and whether it may be None."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        inner, extras, nullable = unwrapped(args[0])
        return inner, (*extras, *args[1:]), nullable
    if origin in {Union, types.UnionType} and types.NoneType in args:
        rest = tuple(argument for argument in args if argument is not types.NoneType)
        return *unwrapped(Union[rest])[:2], True  # noqa: UP007 # of a list that is known at run time
    return annotation, (), False


def _key(cls: type[Any], name: str, hint: Any) -> Part:
    """Return one value of a TypedDict; where annotations are texts only the hint shows `NotRequired`."""
    if get_origin(hint) in {Required, NotRequired}:
        return Part(get_args(hint)[0], get_origin(hint) is Required)
    return Part(hint, name in getattr(cls, "__required_keys__", ()))


def _default(value: Any) -> Any:
    """Return a default as it is shown; one that is made anew each time is not."""
    if value is dataclasses.MISSING or value is msgspec.NODEFAULT:
        return None
    try:
        return to_plain(value)
    except TypeError:
        return None


def _last(kind: type[Any], extras: tuple[Any, ...], otherwise: Any) -> Any:
    return next((extra for extra in reversed(extras) if isinstance(extra, kind)), otherwise)


def _spelled(annotation: Any) -> str:
    return inspect.formatannotation(annotation, getattr(annotation, "__module__", None))


def _instead(annotation: Any) -> str:
    """Say what to write for a type that cannot travel."""
    if isinstance(annotation, Range | Unit):
        return f"write Annotated[float, {annotation!r}]"
    if getattr(annotation, "__module__", "") == "numpy":
        lists = annotation.__name__ == "ndarray"
        return "write list[float]" if lists else "write float, int or bool; numpy's are taken"
    if hasattr(annotation, "_fields") and isinstance(annotation, type):
        return "write a dataclass instead of a NamedTuple"
    if get_origin(annotation) in _DICTS:
        return "the keys are texts: write dict[str, …]"
    if get_origin(annotation) in _SETS or annotation in _SETS:
        return "write list[…]"
    return f"use {USABLE}"
