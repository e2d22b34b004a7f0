"""Whether a robot fits a slot: it is of the kind, and has the commands that the kind promises. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription, offered


def misfit(robot: RobotDescription, promises: Iterable[CommandSpec], uses: Iterable[str]) -> str:
    """Return why a robot does not keep what a slot expects, as a clause; empty: it does.

    Args:
        robot: as it describes itself.
        promises: commands that the kind of the slot promises, in full.
        uses: names of commands that the parent's page uses.
    """
    return next(_reasons(robot, promises, uses), "")


def _reasons(robot: RobotDescription, promises: Iterable[CommandSpec], uses: Iterable[str]) -> Iterator[str]:
    known = {command.name: command for command in robot.commands}
    for name in uses:
        if name not in known:
            yield f"has no command {name}, which the page uses; it has: {offered(known, name)}"
    for promise in promises:
        command = known.get(promise.name)
        if command is None:
            yield f"has no command {promise.name}; it has: {offered(known, promise.name)}"
        elif command.available:  # of an exposed one nothing is known while its slot is empty
            yield from (
                f"has a command {promise.name} that {difference}"
                for difference in _differences(command, promise)
            )


def _differences(command: CommandSpec, promise: CommandSpec) -> Iterator[str]:
    """Say what of a command breaks its promise."""
    takes = {field.name: field for field in command.parameters}
    for field in promise.parameters:
        own = takes.pop(field.name, None)
        if own is None:
            yield f"takes no {field.name}"
        elif not _takes(own, field):
            yield f"takes {field.name} as {_type_of(own)} instead of {_type_of(field)}"
        elif own.required and not field.required:
            yield f"cannot do without {field.name}"
    yield from (f"also needs {own.name}" for own in takes.values() if own.required)
    gives = {field.name: field for field in command.result}
    for field in promise.result:
        own = gives.get(field.name)
        if own is None:
            yield f"returns no {field.name or 'single value'}"
        elif not _takes(field, own):
            yield f"returns {field.name or 'a value'} as {_type_of(own)} instead of {_type_of(field)}"


def _takes(own: FieldSpec, given: FieldSpec) -> bool:
    """Whether what is meant by one description is taken under the other; ranges belong to each robot."""
    if own.unit != given.unit or (given.nullable and not own.optional):
        return False
    match own.type, given.type:
        case ("float", "int") | ("str", "choice"):
            return True
        case "choice", "choice":
            return set(given.choices) <= set(own.choices)
        case "record", "record":
            return _takes_parts(own, given)
        case one, other:
            same = one == other and len(own.items) == len(given.items)
            return same and all(map(_takes, own.items, given.items))


def _takes_parts(own: FieldSpec, given: FieldSpec) -> bool:
    parts = {part.name: part for part in own.items}
    needed = {part.name for part in own.items if part.required}
    named = {part.name for part in given.items if part.required}
    return needed <= named and all(
        part.name in parts and _takes(parts[part.name], part) for part in given.items
    )


def _type_of(field: FieldSpec) -> str:
    kind = f"one of {', '.join(field.choices)}" if field.type == "choice" else field.type
    return f"{kind} in {field.unit}" if field.unit else kind
