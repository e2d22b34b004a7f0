"""How agents describe themselves: the values that travel, that forms are drawn from and templates match.

Pure data. A robot's description is made from its class (`command.py`) and its present state; nothing
here knows how.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, Literal, NamedTuple

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.permissions import Isolation

Placement = Literal["manual", "advise", "auto"]
"""manual: only people and the page itself move a robot. advise: it says where it would be better off. auto:
it moves there."""

PLACEMENTS: tuple[Placement, ...] = ("manual", "advise", "auto")


class HostLoad(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a host has to do."""

    robots: int = 0
    running: int = 0
    """Commands that run in it."""
    cpu: float = 0.0
    """Part of one processor that its process has used of late."""
    room: int | None = None
    """Robots that it still takes; None: any number."""


ParameterType = Literal["float", "int", "bool", "str", "choice", "list", "tuple", "dict", "record", "bytes"]
"""Of one value. list: values of one kind; tuple: so and so many; dict: values of one kind by any texts;
record: values by fixed names; bytes: a picture."""
LARGEST_GROUP = 1000
"""Children of one group, at most."""

Effect = Literal["read", "repeat", "once"]
"""The effect of a repetition. read: changes nothing, so it also runs beside a moving command. repeat: same
end (go to a point, close). once: adds up (move by, dispense)."""


Offline = Literal["reject", "queue", "memory"]
"""What becomes of a command while its robot is away. reject: it is refused. queue: it may be left as an
order. memory: it only reads, and directories answer with its last result."""

LINK, OPEN_LINK, SIGNED_LINK = "link", "open", "signed"
"""The attribute of a robot with a controller that shows how its link is guarded, and its values. Open: the
controller obeys every program that reaches it (docs/security.md)."""


NESTED: frozenset[ParameterType] = frozenset({"list", "tuple", "dict", "record"})
"""Types of values in which there are values."""


class FieldSpec(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One typed value of a command: a parameter, or a part of its result."""

    name: str
    type: ParameterType
    unit: str = ""
    """Symbol of the unit in which the number is meant, e.g. `m`, `rad`, `N`; empty: a plain number."""
    lower: float | None = None
    upper: float | None = None
    choices: tuple[str, ...] = ()
    nullable: bool = False
    """None is a value of it, too."""
    items: tuple[FieldSpec, ...] = ()
    """Its elements. list, dict: one, for all values; tuple: one for each; record: its parts."""
    required: bool = True
    default: Any = None
    """A plain value."""
    doc: str = ""

    @property
    def optional(self) -> bool:
        """Whether None may be given for it."""
        return self.nullable or (not self.required and self.default is None)

    @property
    def nested(self) -> bool:
        """Whether there are values in it."""
        return self.type in NESTED


class CommandSpec(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, dict=True):
    """One command as its callers see it."""

    name: str
    doc: str = ""
    effect: Effect = "once"
    parameters: tuple[FieldSpec, ...] = ()
    result: tuple[FieldSpec, ...] = ()
    """The parts of the result; one part without a name for a single value; empty when there is none."""
    through: str = ""
    """`slot.command` when it is a child's command, exposed; such a command needs the slot filled."""
    beside: bool = False
    """It runs beside a command that moves, as one that reads does, though it changes something: `set`."""
    offline: Offline = "reject"
    available: bool = True
    """False while the slot it goes through is empty (its parameters are unknown then)."""
    attended: bool = False
    """It goes on only while somebody at a key attends it: see `Attend`."""

    @cached_property
    def by_name(self) -> Mapping[str, FieldSpec]:
        """The parameters by their names, in their order."""
        return {field.name: field for field in self.parameters}


class StreamSpec(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One stream that a robot sends to whoever watches it, and how much it sends now."""

    value: FieldSpec
    """Name, type and unit of what is sent."""
    rate: float = 0.0
    """[1/s] Values that are sent at most; 0: each is."""
    listeners: int = 0
    """Processes that listen now: with none, nothing is sent."""
    sent: int = 0
    """[bytes] sent to all of them in the last second."""
    left_out: int = 0
    """Values since the robot began that were above the rate, or for nobody to wait for."""

    @property
    def name(self) -> str:
        """The stream's name."""
        return self.value.name


class SlotSpec(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One child slot and what is in it."""

    name: str
    kind: str
    doc: str = ""
    optional: bool = False
    """The robot can be used while it is empty."""
    returns: float = 0.0
    """[s] in which a lost child is bound again, also if its process was started anew; 0: as usual."""
    group: str = ""
    """Name of the group that it belongs to: `rovers` for `rovers[0]`; empty: it stands alone."""
    least: int = 0
    """How many slots of the group must be filled before the robot can be used."""
    most: int = 1
    """How many slots the group can have; 1 for a slot that stands alone."""
    choose: str = ""
    """`free`: the robot itself chooses a child for it among those that have nothing to do; empty: a person
    puts one in."""
    where: str = ""
    """What a chosen child must be (`scripts/requirement.py`); empty: anything."""
    why: str = ""
    """Why this child was chosen, as a sentence; empty: a person has put it in."""
    commands: tuple[str, ...] = ()
    """Names of the commands that a child must have, beside its kind: the page uses them, or the kind promises
    them."""
    child: Address | None = None
    lost: str = ""
    """Why the slot is empty, if a child was lost; empty when there never was one or it was released."""
    was: str = ""
    """Name of the child that was lost; empty: none was."""
    watch: bool = False
    """Whether a robot in it is only watched: no lease is taken, and it cannot be commanded."""
    watched: Address | None = None
    """The robot that is watched, in its latest life; it may be away."""
    way: float = 0.0
    """[s] for the way to the child and back, as measured by the renewals of its lease; 0: less than 0.05."""
    bears: float = 0.0
    """[s] for which that way may be cut, or longer than it is, before the lease ends; 0: not told."""
    round_trip: float = 0.0
    """[s] of a renewal to the child and its answer, smoothed; 0: not known."""
    calls: float = 0.0
    """[1/s] Calls of the child, of late."""
    bytes: float = 0.0
    """[bytes/s] to and from the child, of late, where it is in another process."""

    @property
    def filled(self) -> bool:
        """Whether somebody is in it: a child, or a robot that is watched."""
        return self.child is not None or self.watched is not None


RENAMED = {"stop": "halt"}
"""Names that commands had before, and what each is called now."""


def offered(names: Iterable[str], asked: str) -> str:
    """Say which commands there are where the one that was asked for is missing."""
    known = [*names]
    now = RENAMED.get(asked)
    hint = f"; {asked} is called {now} now" if now in known else ""
    return f"{', '.join(known) or 'none'}{hint}"


class Lack(NamedTuple):
    """Children that a robot still needs before it can be used."""

    slot: str
    """Name of the slot or group."""
    kind: str
    number: int
    was: str = ""
    """Name of the child that was lost there; empty: none was, or it is a group."""


def lacking(slots: Iterable[SlotSpec]) -> tuple[Lack, ...]:
    """Return what must be enslaved before a robot with these slots can be used; empty: it is ready."""
    slots = tuple(slots)
    found: dict[str, Lack] = {}
    for slot in slots:
        if slot.group:
            bound = sum(1 for one in slots if one.group == slot.group and one.child is not None)
            found[slot.group] = Lack(slot.group, slot.kind, slot.least - bound)
        elif not (slot.filled or slot.optional):
            found[slot.name] = Lack(slot.name, slot.kind, 1, slot.was)
    return tuple(lack for lack in found.values() if lack.number > 0)


class BondSpec(msgspec.Struct, frozen=True, kw_only=True):
    """The parent of an enslaved robot, as the child sees it."""

    parent: Address
    slot: str
    epoch: int
    remaining: float
    """[s] left of the lease, on the child's clock."""
    away: bool = False
    """Whether the parent's process has ended and the child waits for it so long."""


class _Agent(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The fields that the description of a robot and the listing of any agent share."""

    address: Address
    kinds: tuple[str, ...]
    """Class names, most special first: a slot for `MoveTo` also takes a subclass of it."""
    doc: str = ""
    host: str = ""
    attributes: dict[str, str] = {}
    """Free key-value pairs to search by (panel, place, controller's URL …)."""

    @property
    def name(self) -> str:
        """The agent's name."""
        return self.address.name

    @property
    def kind(self) -> str:
        """The most special kind."""
        return self.kinds[0]

    @property
    def link(self) -> str:
        """How the link to its controller is guarded: `open` or `signed`; empty: it has no controller."""
        return self.attributes.get(LINK, "")

    @property
    def unguarded(self) -> bool:
        """Whether its controller obeys every program that reaches it."""
        return self.link == OPEN_LINK


class RobotDescription(_Agent, frozen=True, kw_only=True, omit_defaults=True):
    """The description of a robot. Any agent may ask for it, also while the robot is enslaved."""

    commands: tuple[CommandSpec, ...] = ()
    slots: tuple[SlotSpec, ...] = ()
    bond: BondSpec | None = None
    epoch: int = 0
    busy: str = ""
    """Name of the command that runs now, or empty."""
    waiting: int = 0
    """Commands in the queue."""
    online: bool = True
    """False while a proxy has lost its controller: its readings are stale."""
    stopped: bool = False
    """True from a protective stop until it is released."""
    stop_reason: str = ""
    """Why it is stopped, for people; empty: it is not."""
    stops: int = 0
    """How many protective stops have begun: a request to end one names the count that its sender saw."""
    abandoned: tuple[str, ...] = ()
    """Commands that were ended and whose code still runs: only a restart of its host ends them."""
    operator: str = ""
    """The person who has control of it: `anna@pts/3`; empty: nobody. See `core/control.py`."""
    operator_since: float = 0.0
    """[s] since 1970."""
    wanted_by: str = ""
    """The person who asks for control; empty: nobody does."""
    offered_to: str = ""
    """The person to whom it is offered; empty: nobody."""
    hands: int = 0
    """How often control has changed hands."""
    paused: str = ""
    """The one who has paused it, for people; empty: it is not paused."""
    drill: str = ""
    """What it suffers for a drill, and who has asked for that; empty: nothing."""
    held: str = ""
    """The step before which it waits then: `step 3: arm.go_to(x=0.3)`; empty: before none."""
    faults: tuple[str, ...] = ()
    """How hooks of its page failed when they were last called, as sentences with page and line."""
    readings: dict[str, float] = {}
    """Its present readings, and `progress` of the running command; an author's own are one sample old."""
    units: dict[str, str] = {}
    """Symbol of the unit of each reading that has one (`State.readings`), e.g. `m`, `rad`, `N`."""
    page: str = ""
    """Where its author keeps its page: a file, and `:Class` where that was named; empty: it has none."""
    kept: dict[str, Any] = {}
    """Its declared state, by name; a value that is too large to show is left out."""
    identity: str = ""
    """Which robot it is, for its whole life: two of one name never have the same. Empty: it takes no
    orders."""
    witness: str = ""
    """The memory of the robot's commands beyond its process, and its beginning: of a proxy its controller,
    in its present life. Empty: nobody."""
    asks: str = ""
    """The question of a command to a person before it goes on; empty: none."""
    isolation: Isolation = "none"
    """How its code is kept from harming others: see `permissions.Isolation`."""
    on_way: str = ""
    """Name of the host to which it is moving; empty: it is not."""
    in_doubt: bool = False
    """Whether it is not known at the moment if it has arrived there."""
    placement: Placement = "manual"
    """How it is moved: see `Placement`."""
    placed: str = ""
    """Why it has moved to where it is, as a sentence; empty: people have put it there."""
    advice: str = ""
    """What the latest look at its place has shown, as a sentence; empty: nobody has looked."""
    advised: str = ""
    """Name of the host on which its calls would take less time, by that look; empty: on none."""
    calls: dict[str, int] = {}
    """How often each command was called, over all incarnations of this name."""
    unchecked: bool = False
    """Whether its code runs though nobody trusted has signed it (`--insecure-any-signer`)."""
    streams: tuple[StreamSpec, ...] = ()
    """What it sends to those who watch it, beside its readings."""
    lends: tuple[str, ...] = ()
    """Names in its page of the roles that it lends, as a service: robots play them as `SERVICE-ROLE`."""

    @property
    def away(self) -> float | None:
        """[s] that it still waits for a parent whose process has ended; None: it does not."""
        return self.bond.remaining if self.bond is not None and self.bond.away else None

    def command(self, name: str) -> CommandSpec | None:
        """Return the command of this name, or None."""
        for command in self.commands:
            if command.name == name:
                return command
        return None

    def slot(self, name: str) -> SlotSpec | None:
        """Return the slot of this name, or None."""
        return next((slot for slot in self.slots if slot.name == name), None)


class Listing(_Agent, frozen=True, kw_only=True, omit_defaults=True):
    """The entry of one agent in a lookup service: enough to choose it, small enough to keep everywhere."""

    commands: tuple[str, ...] = ()
    roles: dict[str, str] = {}
    """Texts of the roles that a service lends, by their names in its page."""
    revision: int = 0
    """Grows whenever the agent changes its listing or returns; a larger one replaces a smaller one."""


class Template(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A query by example: what is given must match, what is not given does not matter."""

    role: Literal["robot", "view", ""] = ""
    name: str = ""
    kind: str = ""
    command: str = ""
    attributes: dict[str, str] = {}

    def matches(self, listing: Listing) -> bool:
        """Whether the listing has everything that this template names."""
        return (
            self.role in {"", listing.address.role}
            and self.name in {"", listing.name}
            and (not self.kind or self.kind in listing.kinds)
            and (not self.command or self.command in listing.commands)
            and self.attributes.items() <= listing.attributes.items()
        )


Arguments = Mapping[str, Any]
"""Arguments of a command by name: numbers in the declared unit, or text with a unit such as `10 cm`."""
