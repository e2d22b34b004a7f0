"""The base classes for users: a robot made of other robots' commands, and services with behaviours."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar, Self, cast

import msgspec

from robotree.vr.author.child import Child, Children, ChildRobot, Exposed, Slotted, slot_of
from robotree.vr.author.context import running
from robotree.vr.author.fields import Kept, declare
from robotree.vr.author.fitting import used_commands
from robotree.vr.author.robot import HOOKS, OPTIONS, Robot, attributes_of, expect_hooks
from robotree.vr.author.space import Space
from robotree.vr.author.stream import DeclaredStream
from robotree.vr.author.watch import Watch
from robotree.vr.base.address import check_name
from robotree.vr.base.description import PLACEMENTS, Placement, SlotSpec, offered
from robotree.vr.base.errors import BadName
from robotree.vr.base.units import Unit
from robotree.vr.core.bonds import Slots

_CACHE = "__robotree_slots__"
_ANNOTATED_SLOT = re.compile(r"(\w+\.)?Child(ren)?\(")


class VirtualRobot(Robot):
    """A robot that commands the children in its slots.

    Subclasses declare slots (`rover = Child("Rover")`), commands (`@command`) and what they let through from
    their children (`move = rover.exposed("move")`). The agent that runs it binds children to the slots.
    """

    field_values: Kept
    """Its settings and declared state."""
    placement: ClassVar[Placement] = "manual"
    """How it is moved unless a person says otherwise: by people alone (`manual`), by people who are told
    where it would be better off (`advise`), or by itself (`auto`)."""
    pinned: ClassVar[bool] = False
    """Whether it is never moved by itself, whatever a person says of its placement."""

    def __init_subclass__(cls) -> None:
        """Find settings and state, and refuse what cannot work: wrong hooks, and slots that are none.

        Raises:
            TypeError: a hook cannot be called, the kind of a slot lacks an exposed command, an attribute is a
                list of `Child`, a setting or state is declared wrongly, or there is no such placement.
            ValueError: a unit of a reading is not known.
        """
        super().__init_subclass__()
        _expect_units(cls)
        for name, annotation in inspect.get_annotations(cls).items():
            if isinstance(annotation, Slotted) or _ANNOTATED_SLOT.match(str(annotation)):
                raise TypeError(
                    f"{cls.__name__}.{name} is only annotated; write: {name} = Child(…), with an ="
                )
        for name, value in vars(cls).items():
            _expect_called(cls, name, value)
            if isinstance(value, Exposed):
                _expect_promised(cls, name, value)
            if isinstance(value, Exposed | Slotted | DeclaredStream) and name in {
                *RESERVED,
                *HOOKS,
                *OPTIONS,
            }:
                raise TypeError(
                    f"{cls.__name__}.{name}: it cannot have this name; every robot uses it itself"
                )
            if kinds := _listed(value):
                count = len(kinds)
                raise TypeError(
                    f"{cls.__name__}.{name} is a {type(value).__name__} of Child, which makes no slots; "
                    f"write: {name} = Children({kinds[0]!r}, least={count}, most={count})"
                )
        if cls.placement not in PLACEMENTS:
            raise TypeError(
                f"{cls.__name__}.placement is {cls.placement!r}; it can be {', '.join(PLACEMENTS)}"
            )
        expect_hooks(cls)
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

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute of the page's own.

        Raises:
            AttributeError: it is a slot or an exposed command: the child would be gone without a word.
        """
        if isinstance(getattr(type(self), name, None), Slotted | Exposed | DeclaredStream):
            raise AttributeError(  # noqa: TRY004 # as Python says of what cannot be set
                f"{type(self).__name__}.{name} is a slot, a stream or an exposed command, which no page "
                f"sets; keep the value under another name, such as self._{name}"
            )
        super().__setattr__(name, value)

    def move_to(self, host: str) -> None:
        """Go on in another host: what follows is carried out there, with the same state and children.

        Nothing happens if it is there already.

        Args:
            host: its name, as `robotree ls --hosts` shows it.

        Raises:
            CannotMove: it stays where it is; the error says why.
        """
        running().move_to(host)

    def host_of(self, child: object) -> str:
        """Return the host on which a child lives, as `move_to` takes it; of a proxy: one that is beside it.

        A proxy lives on no host: if it is at the site of this robot, that is the host of this robot; else the
        first one, by name, of the site at which it is.

        Args:
            child: what is in a slot: `self.host_of(self.rover)`.

        Raises:
            SlotEmpty: there is no child.
            NoHostBeside: there is no host where it is.
            TransportError: it does not answer.
        """
        if not isinstance(child, ChildRobot):
            raise TypeError(
                f"{child!r} is no child of {self.name}: name a slot, as in self.host_of(self.rover)"
            )
        return running().host_of(slot_of(child))

    @property
    def space(self) -> Space:
        """The space of the realm, in which robots write, read and take entries: see `author/space.py`."""
        return Space()

    @property
    def child_slots(self) -> Slots:
        """Its slots as they are now. Do not keep what is returned: the state may be another one later."""
        return self.slots_now()


RESERVED = frozenset(
    {"name"} | {name for name in dir(VirtualRobot) if not name.startswith("_")} - {*HOOKS, *OPTIONS}
)
"""Names that each robot uses itself, so that nothing of a page can have them."""


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
        if isinstance(slot, Watch):  # it gives streams, and no commands
            yield slot.spec()
            continue
        needed = used[name] | {promise.name for promise in slot.promises()}
        yield msgspec.structs.replace(slot.spec(), commands=tuple(sorted(needed)))


def exposures_of(cls: type[Any]) -> dict[str, Exposed]:
    """Return the children's commands that a class and its bases let through, by their names here."""
    return {name: value for name, value in attributes_of(cls).items() if isinstance(value, Exposed)}


def _expect_units(cls: type[Any]) -> None:
    """Refuse units of readings that nobody knows.

    Raises:
        TypeError: `reading_units` is no mapping of texts.
        ValueError: a unit is not known.
    """
    units: Any = cls.reading_units
    if not isinstance(units, Mapping):
        raise TypeError(
            f'{cls.__name__}.reading_units gives units by name: write reading_units = {{"height": "m"}}'
        )
    for symbol in cast("Mapping[str, str]", units).values():
        Unit(symbol)


def _expect_promised(cls: type[Any], name: str, exposed: Exposed) -> None:
    """Refuse to let a command through that the interface of the slot does not have, and wrong units.

    Raises:
        TypeError: it has none of this name, or a unit measures something else than the child's.
    """
    slot = exposed.child
    known = sorted(promise.name for promise in slot.promises())
    if slot.interface is not None and exposed.command not in known:
        reason = f"{slot.name} is of kind {slot.kind}, which has no command {exposed.command!r}"
        raise TypeError(f"{cls.__name__}.{name}: {reason}; it has: {offered(known, exposed.command)}")
    for promise in slot.promises():
        if promise.name == exposed.command:
            try:
                exposed.seen(promise)
            except ValueError as error:
                raise TypeError(f"{cls.__name__}.{name}: {error}") from None


def _expect_called(cls: type[Any], name: str, value: object) -> None:
    """Refuse a slot or an exposed command without its parentheses.

    Raises:
        TypeError: it is one.
    """
    if value is Child or value is Children or value is Watch:
        kind = cast("type[Slotted]", value).__name__
        raise TypeError(f'{cls.__name__}.{name} is {kind} without a kind; write: {name} = {kind}("Arm")')
    if inspect.ismethod(value) and isinstance(slot := value.__self__, Slotted):
        text = f"{slot.name}.{value.__name__}"
        raise TypeError(f"{cls.__name__}.{name} is {text} without parentheses; write: {name} = {text}()")


def _listed(value: object) -> list[str]:
    """Return the kinds of the children in a list, tuple, set or dictionary; empty: it holds none."""
    if not isinstance(value, list | tuple | set | dict):
        return []
    parts = cast("Iterable[object]", value.values() if isinstance(value, dict) else value)
    return [part.kind for part in parts if isinstance(part, Child)]


# -- services: pages that work for robots from outside ---------------------------------------------


MOST_TEXTS = 20
"""Behaviours, and roles, of one service."""
LARGEST_ROLES = 10_000
"""Characters of the roles of one service: every lookup service has them."""


class Service(VirtualRobot):
    """A virtual robot that is there for others, with behaviours of its own.

        class Greeter(Service):
            robot = Watch("Robot", "who is listened to")
            behaviours = {"greet": GREET}

    It watches robots without a lease, offers commands, streams and readings, and brings scripts: its
    behaviours, which are robots named SERVICE-BEHAVIOUR on the same host. They are made with the service, are
    inactive until their partners are there, and go with it. It lends roles: robots that play roles can play
    SERVICE-ROLE as long as the service is listed.
    """

    behaviours: ClassVar[Mapping[str, str]] = {}
    """Texts of scripts (YAML) by name. A partner of the service's own kind is the service itself: the first
    behaviour that has such a partner gets it."""
    lends: ClassVar[Mapping[str, str]] = {}
    """Texts of roles (YAML) by name, which robots play as SERVICE-ROLE, and forget when it leaves."""

    def __init_subclass__(cls) -> None:
        """Refuse behaviours that cannot be made, and roles that cannot be lent.

        Raises:
            TypeError: `behaviours` or `lends` is no mapping of names to texts, or of too many, or too long;
                or see `VirtualRobot`.
        """
        super().__init_subclass__()
        _expect_texts(f"{cls.__name__}.behaviours", cls.behaviours, "script", "greet")
        expect_lendable(f"{cls.__name__}.lends", cls.lends)


def expect_lendable(where: str, given: Any) -> dict[str, str]:
    """Return a copy of the roles that a service lends, texts by name, if they can be lent.

    A name has no `-`, so that `desk-a-b` is a role of `desk-a`, and never one of `desk`.

    Args:
        where: they come from, for people.
        given: they may be anything.

    Raises:
        TypeError: they cannot; says why.
    """
    roles = _expect_texts(where, given, "role", "clerk")
    for name in roles:
        if "-" in name:
            raise TypeError(f"{where}: {name!r} has a '-', which parts a service from its role; leave it out")
    if sum(map(len, roles.values())) > LARGEST_ROLES:
        raise TypeError(f"{where} has more than {LARGEST_ROLES} characters")
    return roles


def _expect_texts(where: str, given: Any, noun: str, example: str) -> dict[str, str]:
    """Return a copy of texts by name; refuse what gives none.

    Raises:
        TypeError: says what is wrong.
    """
    if not isinstance(given, Mapping):
        raise TypeError(f'{where} gives a {noun} by name: write {{"{example}": """…"""}}')
    texts = dict(cast("Mapping[object, object]", given))
    if len(texts) > MOST_TEXTS:
        raise TypeError(f"{where} has more than {MOST_TEXTS}")
    for name, text in texts.items():
        if not (isinstance(name, str) and isinstance(text, str)):
            raise TypeError(f"{where}: {name!r} and its {noun} must be texts")
        try:
            check_name(name)
        except BadName as error:
            raise TypeError(f"{where}: {error}") from None
    return cast("dict[str, str]", texts)
