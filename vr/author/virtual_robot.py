"""What a user subclasses: a robot made of other robots' commands."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Self, cast

import msgspec

from robotree.vr.author.child import Child, Children, Exposed, Slotted
from robotree.vr.author.fields import Kept, declare
from robotree.vr.author.robot import Robot, attributes_of
from robotree.vr.author.usage import used_commands
from robotree.vr.base.description import SlotSpec
from robotree.vr.base.units import Unit
from robotree.vr.core.bonds import Slots

_CACHE = "__robotree_slots__"
_OWN = frozenset(
    {
        *("name", "attributes", "slots_now", "field_values", "child_slots", "kinds", "begins", "online"),
        *("isolated", "halted", "reading_units", "readings", "safe_stop", "resume", "one_at_a_time"),
    }
)
"""What the agent of each robot uses of it, so that no slot can have this name."""
_ANNOTATED_SLOT = re.compile(r"(\w+\.)?Child(ren)?\(")


class VirtualRobot(Robot):
    """A robot that commands the children in its slots.

    Subclasses declare slots (`rover = Child("Rover")`), commands (`@command`) and what they let through from
    their children (`move = rover.exposed("move")`). The agent that runs it binds children to the slots.
    """

    field_values: Kept
    """Its settings and declared state."""

    def __init_subclass__(cls) -> None:
        """Find settings and state, and refuse what cannot work: slow hooks, and slots that are none.

        Raises:
            TypeError: a hook is `async def`, the kind of a slot lacks an exposed command, an attribute is a
                list of `Child`, or a setting or state is declared wrongly.
            ValueError: a unit of a reading is not known.
        """
        super().__init_subclass__()
        for symbol in cls.reading_units.values():
            Unit(symbol)
        for name, annotation in inspect.get_annotations(cls).items():
            if isinstance(annotation, Slotted) or _ANNOTATED_SLOT.match(str(annotation)):
                raise TypeError(
                    f"{cls.__name__}.{name} is only annotated; write: {name} = Child(…), with an ="
                )
        for name, value in vars(cls).items():
            _expect_called(cls, name, value)
            if isinstance(value, Exposed):
                _expect_promised(cls, name, value)
            if isinstance(value, Exposed | Slotted) and name in _OWN:
                raise TypeError(
                    f"{cls.__name__}.{name}: it cannot have this name; every robot uses it itself"
                )
            if kinds := _listed(value):
                count = len(kinds)
                raise TypeError(
                    f"{cls.__name__}.{name} is a {type(value).__name__} of Child, which makes no slots; "
                    f"write: {name} = Children({kinds[0]!r}, least={count}, most={count})"
                )
        for hook in ("readings", "safe_stop", "resume"):
            if inspect.iscoroutinefunction(getattr(cls, hook)):
                raise TypeError(f"{cls.__name__}.{hook} runs in a thread: write it without async")
        declare(cls)

    def __new__(cls, *_arguments: Any, **_named: Any) -> Self:
        """Make a robot whose settings and state can be read from the first line of its constructor on."""
        robot = super().__new__(cls)
        robot.field_values = Kept(cls)
        return robot

    def __init__(self, name: str, attributes: Mapping[str, str] | None = None) -> None:
        """Name the robot; all its slots are empty.

        Args:
            name: unique in the realm.
            attributes: free key-value pairs that lookup templates may ask for.

        Raises:
            BadName: that cannot be a name.
        """
        super().__init__(name, attributes)
        self.field_values.robot = name
        empty = Slots.empty(name, slot_specs(type(self)))
        self.slots_now: Callable[[], Slots] = lambda: empty
        """Where its slots are: in the state that its agent keeps."""

    @property
    def child_slots(self) -> Slots:
        """Its slots as they are now. Do not keep what is returned: the state may be another one later."""
        return self.slots_now()


def slots_of(cls: type[Any]) -> dict[str, Slotted]:
    """Return the slots and groups of slots that a class and its bases declare, by name."""
    return {name: value for name, value in attributes_of(cls).items() if isinstance(value, Slotted)}


def slot_specs(cls: type[Any]) -> tuple[SlotSpec, ...]:
    """Describe the slots of a class, with the commands that a child must have: used or promised ones."""
    known: tuple[SlotSpec, ...] | None = cls.__dict__.get(_CACHE)
    if known is None:
        known = tuple(_specs(cls))
        setattr(cls, _CACHE, known)
    return known


def _specs(cls: type[Any]) -> Iterator[SlotSpec]:
    slots = slots_of(cls)
    groups = {name for name, slot in slots.items() if isinstance(slot, Children)}
    used = used_commands(cls, slots.keys() - groups, groups)
    for exposed in exposures_of(cls).values():
        used.setdefault(exposed.child.name, set()).add(exposed.command)
    for name, slot in slots.items():
        needed = used[name] | {promise.name for promise in slot.promises()}
        yield msgspec.structs.replace(slot.spec(), commands=tuple(sorted(needed)))


def exposures_of(cls: type[Any]) -> dict[str, Exposed]:
    """Return the children's commands that a class and its bases let through, by their names here."""
    return {name: value for name, value in attributes_of(cls).items() if isinstance(value, Exposed)}


def _expect_promised(cls: type[Any], name: str, exposed: Exposed) -> None:
    """Refuse to let a command through that the interface of the slot does not have.

    Raises:
        TypeError: it has none of this name.
    """
    slot = exposed.child
    known = sorted(promise.name for promise in slot.promises())
    if slot.interface is not None and exposed.command not in known:
        told = f"{slot.name} is of kind {slot.kind}, which has no command {exposed.command!r}"
        raise TypeError(f"{cls.__name__}.{name}: {told}; it has: {', '.join(known)}")


def _expect_called(cls: type[Any], name: str, value: object) -> None:
    """Refuse a slot or an exposed command without its parentheses.

    Raises:
        TypeError: it is one.
    """
    if value is Child or value is Children:
        kind = cast("type[Slotted]", value).__name__
        raise TypeError(f'{cls.__name__}.{name} is {kind} without a kind; write: {name} = {kind}("Arm")')
    if inspect.ismethod(value) and isinstance(slot := value.__self__, Slotted):
        told = f"{slot.name}.{value.__name__}"
        raise TypeError(f"{cls.__name__}.{name} is {told} without parentheses; write: {name} = {told}()")


def _listed(value: object) -> list[str]:
    """Return the kinds of the children in a list, tuple, set or dictionary; empty: it holds none."""
    if not isinstance(value, list | tuple | set | dict):
        return []
    parts = cast("Iterable[object]", value.values() if isinstance(value, dict) else value)
    return [part.kind for part in parts if isinstance(part, Child)]
