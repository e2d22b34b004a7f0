"""The description of a kind of robot for a fake: its names, its commands, and their results.

Three sources: a class (an interface of `robotree.kinds`, a proxy's or a page's class), a description as a
living robot gives it, or a file that holds such a description as JSON.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from robotree.vr.author.command import commands_of
from robotree.vr.author.kind import Kind as Interface
from robotree.vr.author.kind import Promised, promises_of
from robotree.vr.author.robot import Robot
from robotree.vr.author.signature import Command
from robotree.vr.author.virtual_robot import VirtualRobot, exposures_of
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription

Source = type[Any] | RobotDescription | str | Path
"""Where a kind is described: a class, a description, or the path of a file with one."""


class Kind(msgspec.Struct, frozen=True):
    """One kind of robot."""

    names: tuple[str, ...]
    """Of its classes, most special first, as in `RobotDescription.kinds`."""
    doc: str
    commands: Mapping[str, CommandSpec]
    returns: Mapping[str, Any]
    """The annotation of each command's result; a description has none, its results are checked by parts."""
    units: Mapping[str, str]
    """Symbol of the unit of each reading."""


def kind_of(source: object) -> Kind:
    """Return the kind that a class, a description or a file describes.

    Raises:
        TypeError: it describes no robot, or declares a command in a way that cannot be called from afar.
        OSError: the file cannot be read.
        ValueError: the file holds no description.
    """
    if isinstance(source, RobotDescription):
        return _from_description(source)
    if isinstance(source, str | Path):
        return _from_description(_read(Path(source)))
    if isinstance(source, type) and issubclass(source, Robot):
        return _from_class(source)
    if isinstance(source, type) and issubclass(source, Interface):
        return _from_interface(source)
    raise TypeError(
        f"{source!r} describes no robot: give a class with commands, such as robotree.kinds.Arm, "
        "a RobotDescription, or the path of a file with one as JSON"
    )


def _read(path: Path) -> RobotDescription:
    try:
        return msgspec.json.decode(path.read_bytes(), type=RobotDescription)
    except msgspec.MsgspecError as error:
        raise ValueError(f"{path} holds no description of a robot: {error}") from None


def _from_description(description: RobotDescription) -> Kind:
    known = {spec.name: msgspec.structs.replace(spec, through="") for spec in description.commands}
    return Kind(description.kinds, description.doc, known, {}, description.units)


def _from_class(cls: type[Robot]) -> Kind:
    commands: Mapping[str, Command] = commands_of(cls)
    exposed = dict(_exposed_by(cls)) if issubclass(cls, VirtualRobot) else {}
    return Kind(
        cls.kinds(),
        (cls.__doc__ or "").strip(),
        {name: each.spec for name, each in commands.items()} | exposed,
        {name: each.returns for name, each in commands.items()},
        dict(cls.reading_units),
    )


def _from_interface(cls: type[Interface]) -> Kind:
    promises = promises_of(cls)
    names = tuple(
        base.__name__ for base in cls.__mro__ if issubclass(base, Interface) and base is not Interface
    )
    return Kind(
        (*names, Robot.__name__),
        (cls.__doc__ or "").strip(),
        {spec.name: spec for spec in promises},
        {spec.name: _returned_by(getattr(cls, spec.name)) for spec in promises},
        {},
    )


def _returned_by(promise: Promised[..., Any]) -> Any:
    return promise.signature().returns


def _exposed_by(cls: type[VirtualRobot]) -> Iterator[tuple[str, CommandSpec]]:
    """Yield the commands that a page lets through, where the kind of the child is one that ships.

    Raises:
        TypeError: it is of another kind, so nothing is known of its commands.
    """
    for name, exposed in exposures_of(cls).items():
        kind = _shipped(exposed.child.kind)
        spec = None if kind is None else kind.commands.get(exposed.command)
        if spec is None:
            raise TypeError(
                f"{cls.__name__}.{name} is a command of its {exposed.child.kind}, which is not known here; "
                f"rehearse the page itself, as Page({cls.__name__}, {exposed.child.name}=...), or give the "
                "description of a living robot"
            )
        yield name, msgspec.structs.replace(exposed.seen(spec), name=name)


def _shipped(name: str) -> Kind | None:
    from robotree import kinds

    found = getattr(kinds, name, None)
    return None if found is None else _from_interface(found)


def blank(fields: tuple[FieldSpec, ...]) -> Any:
    """Return a result of zeros, no, empty texts and first choices; None when there is none."""
    if not fields:
        return None
    if len(fields) == 1 and not fields[0].name:
        return _nothing(fields[0])
    return {field.name: _nothing(field) for field in fields}


def _nothing(field: FieldSpec) -> Any:
    if field.nullable:
        return None
    match field.type:
        case "float" | "int":
            low = float("-inf") if field.lower is None else field.lower
            high = float("inf") if field.upper is None else field.upper
            number = min(max(0.0, low), high)
            return number if field.type == "float" else int(number)
        case "tuple":
            return [_nothing(item) for item in field.items]
        case "record":
            return {item.name: _nothing(item) for item in field.items}
        case "choice":
            return field.choices[0]
        case _:
            return _EMPTY[field.type]


_EMPTY: dict[str, Any] = {"bool": False, "str": "", "list": [], "dict": {}, "bytes": b""}
