"""Child slots, and what a virtual robot's code sees of the child in one.

    self.rover.move(x=1)         waits for the end, returns the result
    self.rover.move.tell(x=1)    waits only until the child has accepted it
    self.rover.move.start(x=1)   returns a future: start on two children, then ask both for the result

A result of several parts reads like an object: `self.arm.get_info().z`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Protocol, overload

from robotree.vr.context import CallFuture, activity_here, running
from robotree.vr.description import SlotSpec
from robotree.vr.errors import BadArgument

if TYPE_CHECKING:
    from robotree.vr.core.bonds import Bond, Slots


class HasSlots(Protocol):
    """What has child slots: a virtual robot."""

    child_slots: Slots


class Record(dict[str, Any]):
    """A result of several parts: by item, as the mapping that it is, or by attribute."""

    __slots__ = ()

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"the result has no {name!r}; it has: {', '.join(self)}") from None


class Child:
    """A slot for one child, declared in the class body: `rover = Child("Rover")`."""

    def __init__(self, kind: str, doc: str = "", *, optional: bool = False) -> None:
        """Declare the slot.

        Args:
            kind: the child must be of a class of this name, or of a subclass.
            doc: what it is for.
            optional: the robot can be used without it.
        """
        self.kind, self.doc, self.name, self.optional = kind, doc, "", optional

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.name = name

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> Child: ...
    @overload
    def __get__(self, robot: HasSlots, owner: type[Any]) -> ChildRobot: ...
    def __get__(self, robot: HasSlots | None, owner: type[Any]) -> Child | ChildRobot:
        return self if robot is None else ChildRobot(robot.child_slots, self.name)

    def exposed(self, command: str = "") -> Exposed:
        """Let callers from above use one of the child's commands: `move = rover.exposed()`.

        Args:
            command: its name at the child; empty: that of the attribute.
        """
        return Exposed(self, command)

    def spec(self) -> SlotSpec:
        """Describe the empty slot."""
        return SlotSpec(name=self.name, kind=self.kind, doc=self.doc, optional=self.optional)


class Exposed:
    """A child's command under a name of this robot."""

    def __init__(self, child: Child, command: str) -> None:
        """Made by `Child.exposed`."""
        self.child, self.command = child, command

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.command = self.command or name

    @overload
    def __get__(self, robot: None, owner: type[Any]) -> Exposed: ...
    @overload
    def __get__(self, robot: HasSlots, owner: type[Any]) -> ChildCommand: ...
    def __get__(self, robot: HasSlots | None, owner: type[Any]) -> Exposed | ChildCommand:
        return self if robot is None else ChildCommand(robot.child_slots, self.child.name, self.command)


class ChildRobot:
    """The child in a slot, false while the slot is empty. Its attributes are its commands."""

    __slots__ = ("_slot", "_slots")

    def __init__(self, slots: Slots, slot: str) -> None:
        """Made by access to the slot."""
        self._slots, self._slot = slots, slot

    def __bool__(self) -> bool:
        return self._bond() is not None

    def __str__(self) -> str:
        bond = self._bond()
        return f"nobody in {self._slot}" if bond is None else bond.child.name

    def _bond(self) -> Bond | None:
        """Return what is in the slot; in a running command that is one of its steps."""
        activity = activity_here()
        slot = self._slots[self._slot]
        bond: Bond | None = slot.bond if activity is None else activity.observe(lambda: slot.bond)
        return bond

    def __getattr__(self, command: str) -> ChildCommand:
        if command.startswith("_"):
            raise AttributeError(command)
        return ChildCommand(self._slots, self._slot, command)


class ChildCommand:
    """One command of the child in a slot."""

    __slots__ = ("_command", "_slot", "_slots")

    def __init__(self, slots: Slots, slot: str, command: str) -> None:
        """Made by access to the child's attribute."""
        self._slots, self._slot, self._command = slots, slot, command

    def __call__(self, *values: Any, **arguments: Any) -> Any:
        """Have it carried out, wait for the end and return the result.

        Raises:
            VrError: what the child raised, or why it could not be asked.
        """
        return running().call(self._slot, self._command, self._named(values, arguments))

    def start(self, *values: Any, **arguments: Any) -> CallFuture:
        """Have it carried out meanwhile; it ends with the running command at the latest."""
        return running().start(self._slot, self._command, self._named(values, arguments))

    def tell(self, *values: Any, **arguments: Any) -> None:
        """Have it carried out, and wait only until the child has accepted it."""
        running().tell(self._slot, self._command, self._named(values, arguments))

    def _named(self, values: tuple[Any, ...], arguments: dict[str, Any]) -> Mapping[str, Any]:
        if not values:
            return arguments
        spec = self._slots.require(self._slot).description.command(self._command)
        names = [] if spec is None else [field.name for field in spec.parameters]
        label = f"{self._slot}.{self._command}"
        if len(values) > len(names):
            takes = f"{len(names)} ({', '.join(names)})"
            raise BadArgument(
                command=label, parameter=f"value {len(names) + 1}", reason=f"too many; it takes {takes}"
            )
        positional = dict(zip(names, values, strict=False))
        for name in positional.keys() & arguments:
            raise BadArgument(command=label, parameter=name, reason="is given twice")
        return positional | arguments
