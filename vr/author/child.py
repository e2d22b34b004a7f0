"""Child slots, and what a virtual robot's code sees of the child in one.

    self.rover.move(x=1)         waits for the end, returns the result
    self.rover.move.start(x=1)   returns a future; what it has started ends with the running command
    self.rover.move.tell(x=1)    the same without a future, and it goes on when the command has ended

A result of several parts reads like an object: `self.arm.get_info().z`.

An array of children of one kind is `rovers = Children("Rover", least=1, most=4)`:

    for rover in self.rovers: …  those that are bound now, by index
    self.rovers.move(x=1)        all of them at the same time; returns their results
    self.rovers[2].move(x=1)     a child keeps its index; raises SlotEmpty where one was lost
    len(self.rovers)             how many are bound
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Generic, Literal, Protocol, TypeVar, cast, overload

import msgspec

from robotree.vr.author.context import CallFuture, CallLimit, activity_here, running
from robotree.vr.author.kind import Kind, promises_of
from robotree.vr.author.readings import Readings, Record
from robotree.vr.base.arguments import named_arguments
from robotree.vr.base.description import LARGEST_GROUP, CommandSpec, FieldSpec, SlotSpec
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.plain import READY
from robotree.vr.base.units import Unit, convert

if TYPE_CHECKING:
    from robotree.vr.core.bonds import Bond, Slot, Slots


if TYPE_CHECKING:
    import typing_extensions

    K = typing_extensions.TypeVar("K", bound="Kind | ChildRobot", default="ChildRobot")
    """What a page sees of a child: its kind, or where that is only a name, any commands."""
else:
    K = TypeVar("K")

Choice = Literal["", "free"]
"""How a child comes into a slot: a person puts it in, or the robot chooses one that is free."""
WITHIN = "within"
"""The argument of a call that limits its time."""


class HasSlots(Protocol):
    """An object with child slots: a virtual robot."""

    @property
    def child_slots(self) -> Slots:
        """The slots as they are now."""
        ...


def readable(value: Any) -> Any:
    """Return a plain result with each mapping in it as a `Record`."""
    if isinstance(value, dict):
        parts = cast("dict[str, Any]", value)
        return Record({name: readable(part) for name, part in parts.items()})
    if isinstance(value, list):
        return [readable(part) for part in cast("Sequence[Any]", value)]
    return value


class Slotted:
    """The base of slots and groups of slots: a kind, as a name or as an interface."""

    optional: bool = False

    def __init__(
        self, kind: str | type[object], doc: str, returns: float = 0.0, choose: str = "", where: str = ""
    ) -> None:
        """Take the kind, what the children are for, and how they come and come back: see `Child`.

        Raises:
            TypeError: it is no kind, `doc` no text, or there is no such way to choose.
        """
        interface: type[Any] | None = kind if isinstance(kind, type) else None
        if interface is not None and not issubclass(interface, Kind):
            raise TypeError(
                f"{interface.__name__} is no kind; import one from robotree.kinds, "
                f"write one with `robotree stubs NAME`, or give its name: {interface.__name__!r}"
            )
        if interface is None and not (isinstance(kind, str) and kind.isidentifier()):
            raise TypeError(f"{kind!r} is no kind; write the name of a class, such as 'Arm'")
        said: Any = doc
        if not isinstance(said, str):
            raise TypeError(f"{doc!r} says nothing about the children; write least=… and most=… by name")
        self.kind: str = interface.__name__ if interface else str(kind)
        if choose not in {"", "free"}:
            raise TypeError(f'Child({self.kind!r}, choose={choose!r}): write choose="free", or leave it away')
        if where and not choose:
            raise TypeError(f'Child({self.kind!r}, where={where!r}): write choose="free", too')
        self.doc, self.name, self.interface = doc, "", interface
        self.returns, self.choose, self.where = returns, choose, where

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.name = name

    def spec(self) -> SlotSpec:
        """Describe it, without children."""
        same = ("name", "kind", "doc", "optional", "returns", "choose", "where")
        return SlotSpec(**{name: getattr(self, name) for name in same})

    def promises(self) -> tuple[CommandSpec, ...]:
        """Return the commands that the kind promises; none when it is only a name."""
        return promises_of(self.interface) if self.interface else ()


class Child(Slotted, Generic[K]):
    """A slot for one child, declared in the class body: `rover = Child("Rover")` or `Child(Rover)`."""

    def __init__(
        self,
        kind: str | type[K],
        doc: str = "",
        *,
        optional: bool = False,
        returns: float = 0.0,
        choose: Choice = "",
        where: str = "",
    ) -> None:
        """Declare the slot.

        Args:
            kind: the child must be of a class of this name, or of a subclass, and have the commands that the
                page uses; or, with an interface (`Kind`), those that it promises.
            doc: what it is for.
            optional: the robot can be used without it.
            returns: [s] in which a child that was lost is bound again, also if its process was started anew,
                unless somebody has used it meanwhile; 0: a minute, and only if its process lives on.
            choose: "free": the robot itself puts a child in, one that nobody commands and that has nothing to
                do; while it is used it is this one, and after `returns` another one. "": a person does.
            where: what a chosen child must be: `battery > 30 and near hall`.

        Raises:
            TypeError: `kind` is none, or `choose` or `where` cannot be so.
        """
        super().__init__(kind, doc, returns, choose, where)
        self.optional = optional

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> Child[K]: ...
    @overload
    def __get__(self, robot: HasSlots, owner: type[Any]) -> K: ...
    def __get__(self, robot: HasSlots | None, owner: type[Any]) -> Any:
        if robot is None:
            return self
        child = vars(robot)[self.name] = ChildRobot(robot, self.name)  # from now on found there at once
        return child

    def exposed(self, command: str = "", **units: Unit) -> Exposed:
        """Let callers from above use one of the child's commands: `move = rover.exposed()`.

        Args:
            command: its name at the child; empty: that of the attribute.
            **units: in which the callers give parameters and read parts of the result, where these are
                other ones than the child's: `go_to = arm.exposed(x=Unit("mm"))`. `result` means a result
                that has no parts.
        """
        for name, unit in units.items():
            given: Any = unit
            if not isinstance(given, Unit):
                correct = f"exposed({name}={unit!r})"
                raise TypeError(f"{correct}: a unit is written {name}=Unit({str(unit)!r})")
        return Exposed(self, command, {name: unit.symbol for name, unit in units.items()})


class Children(Slotted, Generic[K]):
    """An array of children of one kind: `rovers = Children("Rover", least=1, most=4)`."""

    def __init__(
        self,
        kind: str | type[K],
        doc: str = "",
        *,
        least: int = 1,
        most: int | None = None,
        count: int = 0,
        choose: Choice = "",
        where: str = "",
        returns: float = 0.0,
    ) -> None:
        """Declare the slots `NAME[0]`, `NAME[1]` and so on.

        Args:
            kind: of each child, as for `Child`.
            doc: what they are for.
            least: how many must be bound before the robot can be used; 0: it can be used without.
            most: how many can be bound; None: 1000.
            count: how many are chosen, instead of `least` and `most`; 0: these say it.
            choose: as for `Child`: `least` children are chosen.
            where: as for `Child`.
            returns: [s] as for `Child`.

        Raises:
            TypeError: `kind` is none, `least`, `most` or `count` no such number, or the way to choose none.
        """
        super().__init__(kind, doc, returns, choose, where)
        if count:
            if most is not None or least != 1:
                raise TypeError(
                    f"Children({self.kind!r}, count={count}): it stands instead of least and most"
                )
            least = most = count
        upper = LARGEST_GROUP if most is None else most
        if not 0 <= least <= upper <= LARGEST_GROUP or upper < 1:
            raise TypeError(
                f"Children({self.kind!r}, least={least}, most={most}): `least` is 0 or more, "
                f"`most` at least that, and from 1 to {LARGEST_GROUP}"
            )
        self.least, self.most = least, upper

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> Children[K]: ...
    @overload
    def __get__(self, robot: HasSlots, owner: type[Any]) -> ChildGroup[K]: ...
    def __get__(self, robot: HasSlots | None, owner: type[Any]) -> Children[K] | ChildGroup[K]:
        return self if robot is None else ChildGroup(robot, self.name)

    def spec(self) -> SlotSpec:
        """Describe the group, without children."""
        return msgspec.structs.replace(super().spec(), group=self.name, least=self.least, most=self.most)


class ChildGroup(Generic[K]):
    """The children of a group that are bound, by index; false while there are none."""

    __slots__ = ("_group", "_robot")

    def __init__(self, robot: HasSlots, group: str) -> None:
        """Made by access to the group."""
        self._robot, self._group = robot, group

    def __len__(self) -> int:
        return len(self._bound())

    def __iter__(self) -> Iterator[K]:
        return iter([self._child(index) for index in self._bound()])

    def __getitem__(self, index: int) -> K:
        """Return the child with an index.

        Raises:
            IndexError: the group has no such index.
            SlotEmpty: nobody is in this slot; says why.
        """
        slots = self._robot.child_slots
        spec = slots.groups[self._group]
        name = f"{self._group}[{index}]"
        if not 0 <= index < spec.most:
            raise IndexError(f"{slots.robot} has no {name}; it has {self._group}[0] to [{spec.most - 1}]")
        if observed(lambda: slots[name].bond) is None:
            raise slots.emptiness(name)
        child: K = self._child(index)
        return child

    def items(self) -> list[tuple[int, K]]:
        """Return index and child of all that are bound; an index is skipped where a child was lost."""
        return [(index, self._child(index)) for index in self._bound()]

    def __getattr__(self, command: str) -> GroupCommand:
        if command.startswith("_"):
            raise AttributeError(command)
        return GroupCommand(self, command)

    def __str__(self) -> str:
        return ", ".join(map(str, self)) or f"nobody in {self._group}"

    def _child(self, index: int) -> Any:
        return ChildRobot(self._robot, f"{self._group}[{index}]")

    def _bound(self) -> list[int]:
        members: dict[int, Slot] = self._robot.child_slots.members(self._group)
        found: list[int] = observed(lambda: [index for index, one in members.items() if one.bond])
        return found


class GroupCommand:
    """One command of all children of a group, which carry it out at the same time."""

    __slots__ = ("_command", "_group")

    def __init__(self, group: ChildGroup[Any], command: str) -> None:
        """Made by access to the group's attribute."""
        self._group, self._command = group, command

    def __call__(self, *values: Any, **arguments: Any) -> list[Any]:
        """Have all that are bound carry it out, and wait until all have ended.

        Returns:
            Their results, in the order of their index.

        Raises:
            VrError: the first failure; the others are cancelled then.
        """
        with running().together(first=False) as parts:
            for child in self._group:
                parts.start(getattr(child, self._command), *values, **arguments)
        results: list[Any] = parts.results
        return results


def observed(look: Callable[[], Any]) -> Any:
    """Look at the slots; in a running command that is one of its steps."""
    activity = activity_here()
    return look() if activity is None else activity.observe(look)


class Exposed:
    """A child's command under a name of this robot."""

    def __init__(self, child: Child[Any], command: str, units: Mapping[str, str]) -> None:
        """Made by `Child.exposed`."""
        self.child, self.command, self.units = child, command, units

    def seen(self, spec: CommandSpec) -> CommandSpec:
        """Return a command of the child as callers from above see it.

        Raises:
            ValueError: a unit measures something else than the child's, or is for nothing that it has.
        """
        if not self.units:
            return spec
        fields = (*spec.parameters, *spec.result)
        for name, unit in self.units.items():
            found = [field for field in fields if (field.name or "result") == name]
            if not found or not all(field.unit for field in found):
                raise ValueError(f"{self.child.name}.{self.command} has no {name!r} with a unit")
            convert(1.0, unit, found[0].unit)
        return msgspec.structs.replace(
            spec,
            parameters=tuple(map(self._seen, spec.parameters)),
            result=tuple(map(self._seen, spec.result)),
        )

    def _seen(self, field: FieldSpec) -> FieldSpec:
        unit = self.units.get(field.name or "result", field.unit)
        if unit == field.unit:
            return field
        lower, upper, default = (
            _converted(value, field.unit, unit) for value in (field.lower, field.upper, field.default)
        )
        return msgspec.structs.replace(field, unit=unit, lower=lower, upper=upper, default=default)

    def for_child(self, spec: CommandSpec, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return what callers gave in their units, in those of the child."""
        wanted = {field.name: field.unit for field in spec.parameters if field.name in self.units}
        return {
            name: _converted(value, self.units[name], wanted[name]) if name in wanted else value
            for name, value in arguments.items()
        }

    def for_caller(self, spec: CommandSpec, result: Any) -> Any:
        """Return what the child gave in its units, in those of the callers."""
        given = {field.name or "result": field.unit for field in spec.result}
        parts = cast("dict[str, Any]", result) if isinstance(result, dict) else {"result": result}
        seen = {
            name: _converted(value, given[name], self.units[name]) if name in self.units else value
            for name, value in parts.items()
        }
        return Record(seen) if isinstance(result, dict) else seen["result"]

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.command = self.command or name

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> Exposed: ...
    @overload
    def __get__(self, robot: HasSlots, owner: type[Any]) -> ChildCommand: ...
    def __get__(self, robot: HasSlots | None, owner: type[Any]) -> Exposed | ChildCommand:
        return self if robot is None else ChildCommand(robot, self.child.name, self.command)


class ChildRobot:
    """The child in a slot, false while the slot is empty. Its attributes are its commands."""

    def __init__(self, robot: HasSlots, slot: str) -> None:
        """Made by access to the slot."""
        self._robot, self._slot = robot, slot

    def __bool__(self) -> bool:
        return self._bond() is not None

    def __str__(self) -> str:
        bond = self._bond()
        return f"nobody in {self._slot}" if bond is None else bond.child.name

    @property
    def readings(self) -> Readings:
        """The readings of the child, as it publishes them."""
        return Readings(self._slot)

    def _bond(self) -> Bond | None:
        """Return what is in the slot; in a running command that is one of its steps."""
        robot, slot = self._robot, self._slot
        bond: Bond | None = observed(lambda: robot.child_slots[slot].bond)
        return bond

    def __getattr__(self, command: str) -> ChildCommand:
        if command.startswith("_"):
            raise AttributeError(command)
        found = vars(self)[command] = ChildCommand(self._robot, self._slot, command)
        return found


class ChildCommand:
    """One command of the child in a slot."""

    __slots__ = ("_command", "_robot", "_slot")

    def __init__(self, robot: HasSlots, slot: str, command: str) -> None:
        """Made by access to the child's attribute."""
        self._robot, self._slot, self._command = robot, slot, command

    def __call__(self, *values: Any, **arguments: Any) -> Any:
        """Have it carried out, wait for the end and return the result.

        `within=5` or `within="500 ms"` gives this call a limit of its own, and `within=None` none, unless the
        command has a parameter of this name.

        Raises:
            ChildTimeout: the limit is over; the child's command is cancelled.
            VrError: what the child raised, or why it could not be asked.
        """
        return running().call(self._slot, self._command, *self.asked(values, arguments))

    def start(self, *values: Any, **arguments: Any) -> CallFuture:
        """Have it carried out meanwhile; it ends with the running command, or when its `within` is over."""
        return running().start(self._slot, self._command, *self.asked(values, arguments))

    def tell(self, *values: Any, **arguments: Any) -> None:
        """Have it carried out, wait only until the child has accepted it; it goes on after this command."""
        running().tell(self._slot, self._command, self._named(values, arguments))

    def asked(
        self, values: tuple[Any, ...], arguments: dict[str, Any]
    ) -> tuple[Mapping[str, Any], CallLimit | None]:
        """Return the arguments of a call by name, and its own limit.

        Raises:
            BadArgument: there are too many, one of them twice, or the limit is no time.
            SlotEmpty: there is no child that would know the names.
        """
        limit = self._limit(arguments) if WITHIN in arguments else None
        return self._named(values, arguments), limit

    def _limit(self, arguments: dict[str, Any]) -> CallLimit | None:
        """Take the limit of this call out of its arguments, if it is none of the command.

        Raises:
            BadArgument: it is no time.
        """
        spec = self._robot.child_slots.require(self._slot).description.command(self._command)
        if spec is not None and WITHIN in spec.by_name:
            return None
        try:
            return CallLimit.of(arguments.pop(WITHIN))
        except (TypeError, ValueError) as error:
            label = f"{self._slot}.{self._command}"
            raise BadArgument(command=label, parameter=WITHIN, reason=str(error)) from None

    def _named(self, values: tuple[Any, ...], arguments: dict[str, Any]) -> Mapping[str, Any]:
        if not values and READY.issuperset(map(type, arguments.values())):
            return arguments
        return named_arguments(f"{self._slot}.{self._command}", values, arguments, self._parameters)

    def _parameters(self) -> list[str]:
        spec = self._robot.child_slots.require(self._slot).description.command(self._command)
        return [] if spec is None else [field.name for field in spec.parameters]


def _converted(value: Any, given: str, wanted: str) -> Any:
    """Return a number, or the numbers in a list, in another unit; what is none stays."""
    if isinstance(value, (list, tuple)):
        return [_converted(one, given, wanted) for one in cast("Sequence[Any]", value)]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return value
    return convert(float(value), given, wanted)


def slot_of(child: ChildRobot) -> str:
    """Return the name of the slot in which a child is."""
    slot: str = vars(child)["_slot"]
    return slot
