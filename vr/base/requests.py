"""The messages between agents: one tagged value per request and per reply, as MessagePack.

A request is answered by one reply, except `Call`, which is answered by `Accepted`, any number of
`Progress` and one `Returned`, and `SafeStop`, by `Accepted` and `Done`; `Raised` may end any of them.
Decoding never trusts the sender: what cannot be read is `Garbled`. Each request travels in an envelope
(`envelope.py`).
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple, TypeVar

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import (
    CommandSpec,
    FieldSpec,
    HostLoad,
    Listing,
    Placement,
    RobotDescription,
    Template,
)
from robotree.vr.base.entry import Entry
from robotree.vr.base.errors import Garbled, VrError
from robotree.vr.base.history_event import NumberedEvent
from robotree.vr.base.order import KnownAgent, Order, OrderHold
from robotree.vr.base.own_class import OwnClass
from robotree.vr.base.permissions import Isolation, SignedManifest
from robotree.vr.base.permit import Permit
from robotree.vr.base.policy import Person

ANSWER_WITHIN = 5.0
"""[s] for an answer that takes no work: two round trips over 1 s each way, and some."""
LONGEST_CLEANUP = 60.0
"""[s] that an author may give a clean-up (`Robot.cleanup`): a command may end so much after its deadline."""


class _Message(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag=True):
    """A value that travels under its class name."""


# -- asked of a robot ------------------------------------------------------------------------------


class Describe(_Message, frozen=True, kw_only=True):
    """Ask a robot for its description. Answered by `Described`; anyone may ask."""


class Call(_Message, frozen=True, kw_only=True):
    """Carry out one command."""

    key: str
    """`command id / path`: the same key with the same content is carried out once and answered twice."""
    command: str
    arguments: dict[str, Any] = {}
    epoch: int | None = None
    """Epoch of the caller's lease; None: the caller is nobody's parent (an operator, for a free robot)."""
    caller: str = ""
    """Name of the caller, for people to read."""
    deadline: float
    """[s] from the moment when it was asked, within which the command must be done; inherited down the
    tree."""
    oneway: bool = False
    """The caller waits for `Accepted` only."""
    describe_result: bool = False
    """`Returned` shall also say what the result is."""
    source: str = ""
    """Of a caller that numbers its calls: unique for it and its present life. Empty: it does not."""
    number: int = 0
    lowest: int = 0
    """Below which number none of the caller's calls matters to it any more: a late copy is refused."""
    line: int = 0
    """Of the caller's page, at which it is called; 0: not known."""
    witness: str = ""
    """An earlier process of the robot was given this call, and this was its `RobotDescription.witness` then:
    only what was not done yet is to be done. Empty: none was."""
    permit: str = ""
    """Id of the permit with which an assistant asks, where the policy wants one."""
    vouched: Permit | None = None
    """That permit, as the gateway of this machine vouches for it; None: it was given at this site."""
    note: str = ""
    """For the history: why the caller asks, in its own words, and who has said yes."""
    attended: float = 0.0
    """[s] from the moment when it was asked, for which somebody at a key attends it (`Attend` prolongs that);
    0: nobody does."""


class Attend(_Message, frozen=True, kw_only=True):
    """Somebody at a key attends a command of the asker that goes on. Answered by `Done`.

    It counts from the moment of the key, not of its arrival, so one that lay in a line or a frozen process
    prolongs nothing.
    """

    key: str
    epoch: int | None = None
    age: float = 0.0
    """[s] before the moment of asking, at which the key was pressed."""


class SetControl(_Message, frozen=True, kw_only=True):
    """An operator gets, asks for, offers, takes or leaves control of a robot: see `core/control.py`.

    Answered by `Done`, with who has it now in its note.
    """

    what: Literal["get", "ask", "offer", "take", "leave"]
    person: str = ""
    """Of an offer: to whom; empty: to who asks."""
    within: float = 0.0
    """[s] for which; 0: as long as the asker's program is present."""
    seen: int = -1
    """Of a take: `RobotDescription.hands` when the person decided; -1: not known."""


class Detach(_Message, frozen=True, kw_only=True):
    """A command goes on when the one that has called it ends. Answered by `Done`."""

    key: str
    epoch: int | None = None


class Cancel(_Message, frozen=True, kw_only=True):
    """End a command that waits or runs: by its key, or all of them (empty key). Answered by `Done`."""

    key: str = ""
    epoch: int | None = None
    reason: str = ""


class Decide(_Message, frozen=True, kw_only=True):
    """Answer what a command of the robot asks after a crash. Answered by `Done`."""

    answer: Literal["done", "again", "abort"]
    """It is done; it goes on; it ends as `CommandInDoubt`."""
    epoch: int | None = None


class Pause(_Message, frozen=True, kw_only=True):
    """Have the commands of a virtual robot, and of those below it, wait before each step.

    Answered by `Done` with a note for people.
    """


class TakeStep(_Message, frozen=True, kw_only=True):
    """Let one step of a paused robot, or of one below it, pass. Answered by `Done` with the step in words."""

    epoch: int | None = None
    within: float = ANSWER_WITHIN
    """[s] in which the answer must leave."""


class Continue(_Message, frozen=True, kw_only=True):
    """End the pause of a robot and of those below it. Answered by `Done`."""


class Disturb(_Message, frozen=True, kw_only=True):
    """Have a robot suffer, for a drill, what an accident would do to it. Answered by `Done`.

    It is over after `seconds`, when the program that asked is present no more, or with the next one. Its
    state says meanwhile what it is and who has asked for it.
    """

    fault: Literal["", "cut", "delay", "freeze", "kill"]
    """cut: nothing crosses the link to its controller; delay: everything takes longer there; freeze, kill:
    somebody else does that to its process, and the robot only says so; empty: the drill ends."""
    seconds: float = 0.0
    """[s] that it lasts at most."""
    delay: float = 0.0
    """[s] each way."""


class SetPlacement(_Message, frozen=True, kw_only=True):
    """Say how a virtual robot may be moved. Answered by `Done` with a note for people."""

    placement: Placement


class Petition(_Message, frozen=True, kw_only=True):
    """A parent asks to enslave the robot. Answered by `Granted`."""

    parent: Address
    slot: str
    kind: str
    """Kind that the slot takes."""
    promises: tuple[CommandSpec, ...] = ()
    """Commands that the kind promises."""
    uses: tuple[str, ...] = ()
    """Names of commands that the robot must have."""
    lineage: tuple[str, ...]
    """Names from the topmost ancestor down to the parent, to refuse cycles."""
    term: float
    """[s] asked for; the child decides."""
    key: str = ""
    """By which the parent can take it back if no answer comes."""
    returns: int | None = None
    """Epoch of the lease that was lost by silence: granted only if nobody has used the robot since. 0: an
    earlier incarnation was lost: granted only if nobody has used this one. None: it asks anew."""
    patience: float = 0.0
    """[s] after its end in which that lease shall return; 0: as long as usual."""
    waits: float = 0.0
    """[s] that the child is to wait if the parent's process ends: it keeps a journal and comes back."""
    life: int = 0
    """How often the parent's process was started with that journal; 0: it keeps none."""
    asker: Person | None = None
    """The person for whom the parent asks: the policy must allow it to both. None: for none."""
    idle: bool = False
    """The parent has chosen it as one that is free: granted only if it has nothing to do."""


class Retract(_Message, frozen=True, kw_only=True):
    """No answer to a petition came: undo the petition, granted or not. Answered by `Done`."""

    parent: Address
    key: str


class Renew(_Message, frozen=True, kw_only=True):
    """The parent prolongs its lease. Answered by `Granted`; another process of it gets a higher epoch."""

    parent: Address
    epoch: int
    lineage: tuple[str, ...]
    paused: str = ""
    """The person who has paused the parent; empty: nobody."""
    pauses: int = 0
    """How often that has changed: a renewal that comes late changes nothing."""
    life: int = 0
    """How often the parent's process was started with its journal; 0: it keeps none."""
    heir: str = ""
    """The parent is about to move: its next process proves itself by what has this hash. Empty: it is not."""
    proof: str = ""
    """That proof; empty: it has not moved."""


class Release(_Message, frozen=True, kw_only=True):
    """The parent lets the child go. Answered by `Done`."""

    parent: Address
    epoch: int


class SafeStop(_Message, frozen=True, kw_only=True):
    """Protective stop, from anyone, at once, down to the hardware. Answered by `Accepted` and `Done`."""

    reason: str = ""
    within: float = ANSWER_WITHIN
    """[s] from its arrival on, in which the answer must leave to arrive in time."""
    order: str = ""
    """Which order this is part of: a robot that gets one order several times, by several ways, has been
    stopped once. Empty: a separate order."""


class Resume(_Message, frozen=True, kw_only=True):
    """Release a protective stop. Only for those who may command the robot. Answered by `Done`."""

    epoch: int | None = None
    seen: dict[str, int] | None = None
    """How many stops each robot had got when this was asked for, by key; a later stop stays in force, and so
    does that of a robot that is not in it. None: all stops that there are."""
    given: float = math.inf
    """[s] on `clock`: when a person gave it, the same down the tree. A stop that came later stays in force,
    even if the asker has counted it. Infinite: not known."""
    clock: str = ""
    """Name of the asker's monotonic clock, as `envelope.this_clock` gives it."""
    within: float = ANSWER_WITHIN
    """[s] from its arrival on, in which the answer must leave to arrive in time."""


class Enslave(_Message, frozen=True, kw_only=True):
    """Asked of a virtual robot by an operator: bind this child to this slot. Answered by `Described`."""

    slot: str
    child: Address | None = None
    """None: it chooses one itself."""
    where: str = ""
    """What the chosen one must be (`scripts/requirement.py`); empty: what the slot asks for."""


class Free(_Message, frozen=True, kw_only=True):
    """Asked of a virtual robot by an operator: release the child in this slot. Answered by `Described`."""

    slot: str


class Delete(_Message, frozen=True, kw_only=True):
    """Asked of a virtual robot by an operator: release the children and end. Answered by `Done`."""


# -- asked of a host -------------------------------------------------------------------------------


class Create(_Message, frozen=True, kw_only=True):
    """Make a virtual robot of this source, under this name. Answered by `Described`."""

    name: str
    path: str
    """Where the author keeps the source; for messages only, the host never opens it."""
    source: str
    wanted: str = ""
    """Class name; empty: the only virtual robot in the source."""
    files: dict[str, bytes] = {}
    """Modules and data that belong to the source, by their path from its folder."""
    settings: dict[str, Any] = {}
    """Values of its settings that are not the defaults: numbers in the declared units, or text with units."""
    origin: str = ""
    """Where a reload finds the source again, on the author's machine."""
    signed: SignedManifest | None = None
    """What the signer of the page says of it; None: nobody has signed it."""
    isolate: Isolation | Literal[""] = ""
    """Where it runs; empty: as the host has it."""
    sender: str = ""
    """Where it comes from if nobody has signed it, and it is not this user's; only made worse by a host."""
    hash: str = ""
    """Instead of the source: the hash of a page that the host has, or another one."""


class Reload(_Message, frozen=True, kw_only=True):
    """Have a robot go on with another page. Answered by `Reloaded`."""

    page: Create
    """As for a new robot; its name is that of the robot, and its settings do not matter."""
    now: bool = False
    """Cancel the command that is running, instead of waiting for its end."""
    within: float = 10.0
    """[s] for the command that is running to end."""


class Migrate(_Message, frozen=True, kw_only=True):
    """Asked of a host: have one of its robots go on in another host. Answered by `Accepted` and `Done`."""

    robot: str
    """Its name."""
    host: str
    """Name of the other host; `SITE:NAME`, if it is at another site than the asked one."""


class Drain(_Message, frozen=True, kw_only=True):
    """Asked of a host: have all its robots go on in other hosts, one after the other.

    Answered by `Accepted`, a `Progress` for each that has moved, and `Done` with their names.
    """


class PrepareMove(_Message, frozen=True, kw_only=True):
    """Asked of the host to which a robot is to move: load its page. Answered by `MoveReady`."""

    transfer: str
    """Unique for ever."""
    robot: Address
    page: Create
    """As for a new robot; its settings do not matter. To another site goes its hash."""
    sender: str = ""
    """Who has sent the page unsigned, if that was not the user of the hosts."""
    asker: Person | None = None
    """Who wants the robot to move, if that is not the host alone."""
    children: tuple[str, ...] = ()
    """Names of the robots that were put under it: where it runs apart it may command them."""


class TakeRobot(_Message, frozen=True, kw_only=True):
    """The robot itself, for the host that is ready for it. Answered by `MoveDecided`."""

    transfer: str
    robot: Address
    state: bytes
    """`core.machine.encode_state`"""
    now: float
    """[s] on the monotonic clock of the host that it leaves, when this was asked."""
    clock: str
    """Name of that clock: see `envelope.this_clock`."""
    stopped: str = ""
    """Reason of a protective stop that came while it was on its way; empty: none did."""
    order: str = ""
    """Of that stop: see `SafeStop.order`."""
    source: str = ""
    """Name of the host that it leaves."""
    person: str = ""
    """Who wants it to move; empty: a robot, or that host."""
    stood: float = 0.0
    """[s] for which it has stood still when this was asked."""


class AskMove(_Message, frozen=True, kw_only=True):
    """Asked of the host to which a robot may have moved: has it? Answered by `MoveDecided`.

    What is answered is true for ever: a host that says no has written before that it never takes it.
    """

    transfer: str
    robot: Address
    log: str
    """Name of the log that has the answer."""
    stopped: str = ""
    """See `TakeRobot`; so is the next."""
    order: str = ""


class ReadBundle(_Message, frozen=True, kw_only=True):
    """Ask a host for a page by its hash. Answered by `BundleRead`."""

    hash: str
    """`Bundle.hash`, whole."""


class DescribeHost(_Message, frozen=True, kw_only=True):
    """Ask a host what it runs. Answered by `HostDescribed`."""

    ways_to: tuple[str, ...] = ()
    """Keys of agents to which it is to measure the way."""


# -- asked of a lookup service ---------------------------------------------------------------------


class ReadLog(_Message, frozen=True, kw_only=True):
    """Asks a robot for its log. Answered by `Logged`."""

    after: int = 0
    """Number of the last line that is known; 0: none is."""


class ReadHistory(_Message, frozen=True, kw_only=True):
    """Asks a lookup service who came and went, or a host for the logs of its robots that have ended.

    Answered by `History`.
    """


class ReadEvents(_Message, frozen=True, kw_only=True):
    """Asks a host for the kept events of a robot, or of one command. Answered by `EventsRead`."""

    robot: str = ""
    """Its events."""
    key: str = ""
    """Instead: of this call, and of the calls that led to it."""
    last: bool = False
    """Of the robot only the last call that moved it, as by `key`."""
    since: float = 0.0
    """[s] since 1970: from then on."""
    most: int = 1000
    """How many, the latest."""


class VerifyEvents(_Message, frozen=True, kw_only=True):
    """Asks a host whether its kept events are those that it wrote. Answered by `EventsVerified`."""


class Register(_Message, frozen=True, kw_only=True):
    """A process enters, changes or takes out listings and prolongs its lease. Answered by `Registered`.

    All listings of one process depend on one lease, so it renews them together, with an empty request.
    """

    holder: str
    """Of the lease: an identifier that the process has drawn."""
    term: float
    """[s] asked for; the lookup service decides."""
    listings: tuple[Listing, ...] = ()
    """New or changed ones."""
    withdrawn: tuple[tuple[Address, int], ...] = ()
    """Those to be taken out, with the revision that each withdrawal is."""


class Query(_Message, frozen=True, kw_only=True):
    """Which agents match? Answered by `Found`."""

    template: Template = Template()


# -- asked of a view -------------------------------------------------------------------------------


class Look(_Message, frozen=True, kw_only=True):
    """One picture. Answered by `Picture`."""

    camera: str = ""
    """Name of the camera; empty: the first."""
    width: int = 320
    height: int = 180
    quality: int = 75


class DescribeView(_Message, frozen=True, kw_only=True):
    """Ask a view for its cameras and readings. Answered by `ViewDescribed`."""


# -- asked of a gateway ----------------------------------------------------------------------------


class DescribeGateway(_Message, frozen=True, kw_only=True):
    """Ask a gateway how the other sites are. Answered by `GatewayDescribed`."""


# -- asked of a space ------------------------------------------------------------------------------

FOR_EVER = math.inf
"""[s] of a lease that does not end by itself."""


class WriteEntry(_Message, frozen=True, kw_only=True):
    """Put an entry into the space. Answered by `EntryLeased`."""

    entry: Entry
    term: float = FOR_EVER
    """[s] asked for; the space may grant less."""
    key: str = ""
    """A key that no other entry may have; empty: it has none."""
    ask: str = ""
    """Asked again under the same, it is done once, and answered as before; empty: it is not known again."""
    transaction: str = ""
    """In which it is done; empty: in none. So in all that follow."""


class FindEntries(_Message, frozen=True, kw_only=True):
    """Read or take entries that match, the oldest first. Answered by `EntriesFound`."""

    kind: str = ""
    """Name of a class that they must have; empty: any."""
    fields: dict[str, Any] = {}
    """Plain values that they must have."""
    take: bool = False
    most: int = 1
    """How many at most."""
    within: float = 0.0
    """[s] to wait for the first one."""
    ask: str = ""
    """By which it can be given up, see `GiveUp`, and is known again: see `WriteEntry`."""
    transaction: str = ""


class GiveUp(_Message, frozen=True, kw_only=True):
    """The asker waits no longer, or cannot use its entry: it is in the space again. Answered by `Done`."""

    ask: str


class RenewEntry(_Message, frozen=True, kw_only=True):
    """Prolong the lease of an entry, or end it. Answered by `EntryLeased`."""

    id: int
    term: float
    """[s] from now on; 0: it ends."""


class OpenTransaction(_Message, frozen=True, kw_only=True):
    """Begin a transaction. Answered by `TransactionOpened`."""

    term: float
    """[s] after which it is taken back, unless it was committed."""
    ask: str = ""


class CloseTransaction(_Message, frozen=True, kw_only=True):
    """Commit a transaction. Answered by `Done`."""

    transaction: str
    ask: str = ""


class RollBack(_Message, frozen=True, kw_only=True):
    """Take a transaction back. Answered by `Done`, also if it is over."""

    transaction: str


class AcquireFence(_Message, frozen=True, kw_only=True):
    """Become the holder of a name, when it is free. Answered by `FenceGranted`."""

    name: str
    term: float
    """[s] for which it is held, unless that is renewed."""
    within: float = 0.0
    """[s] to wait until it is free."""
    ask: str = ""


class RenewFence(_Message, frozen=True, kw_only=True):
    """OrderHold a name for longer, or let it go. Answered by `FenceGranted`."""

    name: str
    epoch: int
    term: float
    """[s] from now on; 0: let it go."""


class WatchEntries(_Message, frozen=True, kw_only=True):
    """Wait until an entry that matches has become visible. Answered by `EntriesCame`."""

    kind: str = ""
    fields: dict[str, Any] = {}
    since: int = -1
    """Number that the answer before gave; -1: only ask for the present one."""
    within: float = 0.0
    """[s] to wait."""
    ask: str = ""


class DescribeSpace(_Message, frozen=True, kw_only=True):
    """Ask what is in the space. Answered by `SpaceDescribed`."""

    kind: str = ""
    most: int = 0
    """How many entries, the oldest first."""


# -- asked of a directory --------------------------------------------------------------------------


class LeaveOrder(_Message, frozen=True, kw_only=True):
    """Leave a command for a robot, which takes it when it is there and free. Answered by `OrderLeft`.

    The same key with the same command is left once and answered twice.
    """

    key: str
    robot: str
    """Name of the robot."""
    identity: str = ""
    """Which robot of this name; empty: the only one that is known."""
    command: str
    arguments: dict[str, Any] = {}
    begin_within: float
    """[s] in which it must begin."""
    may_take: float
    """[s] that it may take then."""
    ago: float = 0.0
    """[s] since it was left where there was no network."""
    device: str = ""
    """Name of the machine or memory on which it was left; empty: here. It has an inbox of its own."""


class CancelOrder(_Message, frozen=True, kw_only=True):
    """End an order, also if its robot has it. Answered by `OrderLeft`."""

    key: str


OrderOutcome = Literal["", "done", "undone"]
"""What became of an order, as a person says."""


class ConfirmOrder(_Message, frozen=True, kw_only=True):
    """Answer what a robot asks of an order: it may begin; or settle one in doubt. Answered by `OrderLeft`."""

    key: str
    outcome: OrderOutcome = ""
    """What a person has seen of an order in doubt; empty: the robot may begin."""


class ReadOrders(_Message, frozen=True, kw_only=True):
    """Ask for orders, the oldest first. Answered by `OrdersFound`."""

    key: str = ""
    """Beginning of its key; empty: any."""
    robot: str = ""
    """Name of the robot; empty: any."""
    mine: bool = False
    """Only those of the asker."""


class MarkSeen(_Message, frozen=True, kw_only=True):
    """The results of these orders have been taken by their owner. Answered by `Done`."""

    keys: tuple[str, ...]


class FetchOrders(_Message, frozen=True, kw_only=True):
    """A robot asks for its orders that are not over, and for what holds it. Answered by `OrdersFound`."""

    identity: str


class TakeOrder(_Message, frozen=True, kw_only=True):
    """A robot is about to begin an order: it has written that down. Answered by `OrdersFound` with the copy.

    A directory in which it is over by then says so and changes nothing: the robot does not begin.
    """

    key: str
    identity: str


class TellOrders(_Message, frozen=True, kw_only=True):
    """A robot tells how its orders fare. Answered by `OrdersFound`, with the copies that are further on."""

    orders: tuple[Order, ...]
    now: float
    """[s] since 1970, on the sender's clock, which the times in it have."""


class ReadKnown(_Message, frozen=True, kw_only=True):
    """Ask what is remembered of robots and views. Answered by `KnownFound`."""

    name: str = ""
    kind: str = ""
    command: str = ""
    brief: bool = False
    """Leave out commands, pictures and answers."""


class TakeAlong(_Message, frozen=True, kw_only=True):
    """Somebody takes robots along, to leave orders where there is no network. Answered by `KnownFound`."""

    names: tuple[str, ...]
    device: str = ""
    """See `LeaveOrder.device`."""


class HoldOrders(_Message, frozen=True, kw_only=True):
    """Keep robots from beginning what was ordered: a stop of those that are away.

    Answered by `OrdersFound`.
    """

    id: str
    robot: str = ""
    """Name of the robot; empty: all."""


class ReleaseHolds(_Message, frozen=True, kw_only=True):
    """A person lets robots begin again what was ordered. Answered by `OrdersFound`."""

    robot: str = ""
    """Name of the robot; empty: all."""
    ago: float = 0.0
    """[s] since the person gave it: a hold that came later stays."""


class RobotDeleted(_Message, frozen=True, kw_only=True):
    """A robot is deleted and never comes back. Answered by `Done`."""

    identity: str


class ShareRecords(_Message, frozen=True, kw_only=True):
    """A directory gives another one what it has. Answered by `RecordsShared`."""

    now: float
    """[s] since 1970, on the sender's clock, which all times in it have."""
    orders: tuple[Order, ...] = ()
    agents: tuple[KnownAgent, ...] = ()
    holds: tuple[OrderHold, ...] = ()


# -- replies ---------------------------------------------------------------------------------------


class Described(_Message, frozen=True, kw_only=True):
    """A robot's description of itself."""

    robot: RobotDescription


class Accepted(_Message, frozen=True, kw_only=True):
    """The command is in the queue; from here on it is carried out at most once. A stop: it has begun."""

    key: str
    """Of the call, or the stop's order."""
    returns: float = 0.0
    """[s] in which the robot comes back after a crash: asked again under the same key, it goes on. 0: it does
    not come back."""


class Moved(_Message, frozen=True, kw_only=True):
    """The robot goes on in another process: who has called it asks there again, under the same key."""


class MoveReady(_Message, frozen=True, kw_only=True):
    """The page of the robot is loaded, and there is room."""

    log: str
    """Name of the log in which the host writes what it takes."""


class MoveDecided(_Message, frozen=True, kw_only=True):
    """Where the robot is."""

    taken: bool
    """Whether it has moved; else it never does under this transfer."""


class Progress(_Message, frozen=True, kw_only=True):
    """How far the command is."""

    key: str
    fraction: float
    """0 to 1; NaN where it is unknown."""
    text: str = ""


class Returned(_Message, frozen=True, kw_only=True, gc=False):
    """The command succeeded."""

    key: str
    value: Any = None
    fields: tuple[FieldSpec, ...] = ()
    """`CommandSpec.result`, if the call asks for it."""


class Reloaded(_Message, frozen=True, kw_only=True):
    """The robot goes on with another page."""

    robot: RobotDescription
    notes: tuple[str, ...] = ()
    """The changes, as sentences: parts that could not stay, and new ones."""


Level = Literal["debug", "info", "warning", "error", "asked", "done", "failed", "cancelled"]
"""How important a line is; `asked`: a person's command goes on or waits; of the last three, how one ended."""


STOPPED = "stopped: "
"""Begins the line of a robot's log that says why and by whom it was stopped."""


class LoggedLine(msgspec.Struct, frozen=True):
    """One line of a robot's log."""

    number: int
    """Of the lines of this robot; each has a higher one."""
    unix: float
    """[s] since 1970, on the clock of its host."""
    level: Level
    text: str
    command: str = ""
    """The command that was asked for, or has ended so; empty: none. So are all that follow."""
    key: str = ""
    """Of the call; of the agent, where an agent has come or gone."""
    caller: str = ""
    """The asker: a person, `anna@pts/3`, or the robot's parent."""
    arguments: str = ""
    """As they came: `x=0.3 y=0.1`."""
    waited: float = 0.0
    """[s] for its turn."""
    ran: float = 0.0
    """[s]"""


class Logged(_Message, frozen=True, kw_only=True):
    """Lines of a robot's log, the oldest first."""

    lines: tuple[LoggedLine, ...] = ()


class Remembered(msgspec.Struct, frozen=True):
    """One line about an agent that may be there no more."""

    name: str
    """Of the agent."""
    line: LoggedLine


class History(_Message, frozen=True, kw_only=True):
    """The memory of a lookup service or a host, the oldest first."""

    lines: tuple[Remembered, ...] = ()


class EventsRead(_Message, frozen=True, kw_only=True):
    """Kept events, the oldest first."""

    events: tuple[NumberedEvent, ...] = ()
    more: bool = False
    """Whether there are older ones that match."""
    waiting: int = 0
    """Events that have happened and are not in the file yet."""
    trouble: str = ""
    """Why nothing is kept at the moment; empty: all is."""


class EventsVerified(_Message, frozen=True, kw_only=True):
    """The result of an examination of kept events."""

    count: int = 0
    first: int = 0
    """Number of the first event that is kept; older ones were deleted for their age, or for room."""
    last_hash: str = ""
    """Of the last event: who has noted it elsewhere can tell that all before it is as it was."""
    fault: str = ""
    """The first that is missing or changed, as a sentence; empty: none is."""


class Granted(_Message, frozen=True, kw_only=True):
    """The right to command, from now on for `term` seconds of the granter's clock."""

    epoch: int
    term: float
    robot: RobotDescription | None = None
    """The description that the parent can expose: on the first grant, and on renewals after changes."""
    depth: int = 0
    """Levels of robots below the granter."""
    ways: float = 0.0
    """[s] that the ways down through these levels and back take together, as measured."""
    stopped: int = 0
    """Number of the last stop of the granter that came while the parent's process was away."""
    returns: float = 0.0
    """[s] in which the granter comes back after a crash; 0: it does not."""


class HostDescribed(_Message, frozen=True, kw_only=True):
    """A host and the robots in it."""

    address: Address
    robots: tuple[Address, ...] = ()
    abandoned: tuple[str, ...] = ()
    """`robot.command` of robots that were deleted and whose code still runs: only a restart ends it."""
    pages: dict[str, str] = {}
    """Hash of the page of each robot, with what belongs to it (`Bundle.hash`), by the robot's name."""
    trouble: str = ""
    """Why its robots would not survive its end though it keeps them, in words; empty: they would."""
    stands_by: str = ""
    """Name of the host whose robots it takes when that is away; empty: it does not stand by."""
    instead_of: str = ""
    """Name of the host whose robots it has taken over; empty: they are its own."""
    keeps: bool = False
    """Whether it has a journal: only then robots move from it and to it."""
    alone: str = ""
    """Name of the one robot that it runs; empty: it runs any number."""
    on_way: dict[str, str] = {}
    """The hosts to which its robots are moving, by the robot's name."""
    load: HostLoad | None = None
    """What it has to do; None: it does not say."""
    ways: dict[str, float] = {}
    """[s] Round trips to the other hosts, and to those for whom it was asked, by key, as far as known."""

    @property
    def takes_robots(self) -> bool:
        """Whether robots can move to it, as it says of itself."""
        return self.keeps and not (self.stands_by or self.alone or self.trouble)


class SiteSeen(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Another site, as the gateway of this machine knows it."""

    name: str
    kind: Literal["person", "site"] = "site"
    state: Literal["linked", "silent", "away"] = "away"
    """Silent: it was heard a moment ago, and its agents are still listed. Away: they are not."""
    heard: float = -1.0
    """[s] since it was heard last; -1: not since this gateway was started."""
    way: float = 0.0
    """[s] of the shortest way there and back of late; 0: not known."""
    round_trip: float = 0.0
    """[s] of the latest one, with what waits on the line."""
    rate: float = 0.0
    """[bytes/s] that the line carries, at least."""
    agents: int = 0
    """How many are present there."""
    reason: str = ""
    """Why it is not linked, as a clause; empty: it is."""
    remedy: str = ""
    """What a person can do about it."""
    version: str = ""
    """Of robotree there; empty: it did not say."""
    clock: float = 0.0
    """[s] by which its clock is ahead of the one here."""
    ends: float = 0.0
    """[s since 1970] End of its certificate; 0: not known."""
    hung: tuple[tuple[str, str, str], ...] = ()
    """Agents there whose process hangs: name, process, and the remedy for a person who is there."""

    @property
    def age(self) -> float:
        """[s] that what is shown of its agents is old, at least."""
        return max(self.heard, 0.0) + self.way / 2


class GatewayDescribed(_Message, frozen=True, kw_only=True):
    """A gateway and the other sites."""

    site: str
    """The name of this machine's."""
    realm: str
    hub: str
    """Where it dials."""
    trouble: str = ""
    """Why no hub is reached, as a clause; empty: one is."""
    version: str = ""
    ends: float = 0.0
    """[s since 1970] End of the own certificate."""
    out: str = ""
    """Why this machine is out of the realm, as a sentence; empty: it is in it."""
    sites: tuple[SiteSeen, ...] = ()
    refused: dict[str, int] = {}
    """What was refused, and how often."""


class BundleRead(_Message, frozen=True, kw_only=True):
    """A page; its name and its settings do not matter."""

    page: Create | None = None
    """None: the host does not have it."""


class Registered(_Message, frozen=True, kw_only=True):
    """The lease holds for `term` seconds from now on."""

    term: float
    count: int
    """Listings that depend on the lease. Another number than its holder expects: the lease was lost."""
    outdated: tuple[tuple[Address, int], ...] = ()
    """Listings that were refused because a later revision is known, with that revision."""


class Found(_Message, frozen=True, kw_only=True):
    """The listings that match, with what remains of their leases [s]."""

    listings: tuple[tuple[Listing, float], ...] = ()


class EntryLeased(_Message, frozen=True, kw_only=True):
    """An entry stays for `term` seconds from now on, on the clock of the space."""

    id: int
    term: float


class EntriesFound(_Message, frozen=True, kw_only=True):
    """The entries that match, the oldest first; none: the time to wait is over."""

    entries: tuple[tuple[int, Entry], ...] = ()
    ask: str = ""
    """Of the request."""


class TransactionOpened(_Message, frozen=True, kw_only=True):
    """A transaction has begun."""

    transaction: str
    term: float


class FenceGranted(_Message, frozen=True, kw_only=True):
    """A name is held for `term` seconds from now on; 0: it was let go."""

    epoch: int
    """Higher than all before it."""
    term: float


class EntriesCame(_Message, frozen=True, kw_only=True):
    """How many entries have become visible so far."""

    number: int
    came: bool = False
    """Whether one that matches may be among those since the number that was asked with."""


class KeptEntry(msgspec.Struct, frozen=True):
    """One entry, for people who look into a space."""

    id: int
    entry: Entry
    key: str
    term: float
    """[s] that are left of its lease."""
    held: bool
    """Whether a transaction holds it."""


class KeptFence(msgspec.Struct, frozen=True):
    """One fence, for people."""

    name: str
    epoch: int
    holder: str
    """Empty: nobody holds it."""
    term: float
    """[s] that are left."""


class SpaceDescribed(_Message, frozen=True, kw_only=True):
    """The contents of a space."""

    address: Address
    store: str
    """Where it keeps its entries, for people, without passwords."""
    durability: str
    """Their durability: `memory`, `process` or `power`."""
    counts: dict[str, int] = {}
    """Entries by kind."""
    transactions: int = 0
    """The number of open transactions."""
    waiting: int = 0
    """Requests that wait for an entry or a fence."""
    entries: tuple[KeptEntry, ...] = ()
    fences: tuple[KeptFence, ...] = ()


class OrderLeft(_Message, frozen=True, kw_only=True):
    """An order as it is now, and which directories have it so."""

    order: Order
    now: float
    """[s] since 1970, on the directory's clock, which all times in it have."""
    confirmed: tuple[str, ...] = ()
    """Names of the directories that have it as it is here."""
    unconfirmed: tuple[str, ...] = ()
    """Names of those that may have another copy and did not answer."""


class OrdersFound(_Message, frozen=True, kw_only=True):
    """Orders, the oldest first, and the holds that are in force."""

    now: float
    """[s] since 1970, on the directory's clock, which all times in it have."""
    orders: tuple[Order, ...] = ()
    holds: tuple[OrderHold, ...] = ()


class KnownFound(_Message, frozen=True, kw_only=True):
    """What a directory remembers."""

    now: float
    """[s] since 1970, on the directory's clock, which all times in it have."""
    agents: tuple[KnownAgent, ...] = ()
    who: str = ""
    """Whose orders the asker's are, if that was asked."""


class RecordsShared(_Message, frozen=True, kw_only=True):
    """A directory has taken what another one had; here is what is further on in its own memory."""

    now: float
    orders: tuple[Order, ...] = ()
    agents: tuple[KnownAgent, ...] = ()
    holds: tuple[OrderHold, ...] = ()


class CameraLens(msgspec.Struct, frozen=True, kw_only=True):
    """Where a camera was in a picture, and what it saw.

    The camera's frame is the optical one of ROS REP 103: x to the right of the picture, y down, z along the
    view. Pixels are square, and the middle of the picture is on the axis: a pinhole without distortion.
    """

    x: float
    """[m] Position in the frame of the cell, W, as are y and z."""
    y: float
    z: float
    qw: float
    """Orientation of the camera's frame in W, as a unit quaternion."""
    qx: float
    qy: float
    qz: float
    fovy: float
    """[rad] Vertical field of view of the picture."""


class Shot(NamedTuple):
    """A picture as a view takes it."""

    jpeg: bytes
    lens: CameraLens | None = None
    """None: its camera does not say where it is."""


class Picture(_Message, frozen=True, kw_only=True):
    """One JPEG picture."""

    jpeg: bytes
    width: int
    height: int
    camera: str
    lens: CameraLens | None = None
    """Where its camera was; None: it does not say."""


class ViewDescribed(_Message, frozen=True, kw_only=True):
    """A view: its cameras, and what its instruments read (name -> value)."""

    address: Address
    cameras: tuple[str, ...] = ()
    readings: dict[str, float] = {}
    units: dict[str, str] = {}
    """Symbol of the unit of each reading that has one."""
    frame: str = ""
    """Names the frame W in which its cameras are: the attribute `controller` of the robots that share it."""
    skeleton: tuple[tuple[float, float, float], ...] = ()
    """Where the joints of its arm are in that frame [m], from foot to tool; empty: nobody says."""


class Done(_Message, frozen=True, kw_only=True):
    """Carried out."""

    note: str = ""
    """A note for a person, as a sentence; empty: none."""
    confirmed: tuple[str, ...] = ()
    """Names of the robots that have confirmed a stop or its release: the one that was asked and all below."""
    stops: int = -1
    """How many stops the robot that was asked had counted with the one that this confirms; -1: it is none."""


class Raised(_Message, frozen=True, kw_only=True):
    """An error to be raised again on the asking side."""

    error: str
    data: dict[str, Any] = {}
    trace: tuple[str, ...] = ()
    """The lines of the authors' pages through which it came, as in `VrError`."""
    own_class: OwnClass | None = None
    """The class of its page's own as which it was raised; None: it is one of ours."""

    @classmethod
    def of(cls, error: VrError) -> Raised:
        """Pack an error for the journey; one of an author's own class goes as its base, which names it."""
        known = VrError.registered(type(error))
        return cls(error=known.__name__, data=error.data, trace=error.trace, own_class=error.own_class)

    def revive(self) -> VrError:
        """Make the error again."""
        error = VrError.revive(self.error, self.data)
        error.trace, error.own_class = self.trace, self.own_class
        return error


# -- published -------------------------------------------------------------------------------------


class Listed(_Message, frozen=True, kw_only=True):
    """A lookup service publishes: this listing is new or changed."""

    listing: Listing


class Unlisted(_Message, frozen=True, kw_only=True):
    """A lookup service publishes: this listing is out, withdrawn or expired."""

    address: Address
    revision: int


class OrdersChanged(_Message, frozen=True, kw_only=True):
    """A directory publishes, under its key + `/orders`: something has changed for these robots."""

    identities: tuple[str, ...] = ()
    """Empty: for all."""
    results: int = 0
    """How many results have come."""


class LogLines(_Message, frozen=True, kw_only=True):
    """A robot publishes the output of its code, under its key + `/log`."""

    lines: tuple[LoggedLine, ...]


class State(_Message, frozen=True, kw_only=True):
    """A robot publishes its state, at every change and slowly otherwise, under its key + `/state`."""

    busy: str = ""
    waiting: int = 0
    waiters: tuple[str, ...] = ()
    """Who asked for the commands that wait, the next one first; of many only the first ones."""
    epoch: int = 0
    bond: Address | None = None
    away: float | None = None
    """[s] that it still waits for a parent whose process has ended; None: it does not."""
    online: bool = True
    stopped: bool = False
    stop_reason: str = ""
    stops: int = -1
    """How many stops have begun; -1: not reported."""
    abandoned: tuple[str, ...] = ()
    """Commands that were ended and whose code still runs."""
    readings: dict[str, float] = {}
    """The readings that a panel draws: `x`, `y`, `z`, `fx`, `width`, `progress` … in SI units."""
    caller: str = ""
    """The asker of the running command, for people to read."""
    note: str = ""
    """The latest progress text of the running command, for people."""
    paused: str = ""
    """The one who has paused it, for people; empty: it is not paused."""
    held: str = ""
    """The step before which it waits then: `step 3: arm.go_to(x=0.3)`; empty: before none."""
    asks: str = ""
    """The question of a command to a person before it goes on; empty: none."""
    on_way: str = ""
    """Name of the host to which it is moving; empty: it is not."""
    in_doubt: bool = False
    """Whether it is not known at the moment if it has arrived there: nobody acts for it meanwhile."""
    drill: str = ""
    """What it suffers for a drill, and who has asked for that: `cut, by anna@pts/3`; empty: nothing."""
    advised: str = ""
    """See `RobotDescription.advised`."""
    operator: str = ""
    """The person who has control of it; empty: nobody."""
    operator_since: float = 0.0
    """[s] since 1970."""
    wanted_by: str = ""
    """The person who asks for control; empty: nobody does."""
    offered_to: str = ""
    """The person to whom it is offered; empty: nobody."""
    hands: int = 0
    """How often control has changed hands."""


class OperatorHere(_Message, frozen=True, kw_only=True):
    """The program of an operator says who sits there, under its key + `/here`: at each change, and slowly."""

    person: str
    """`anna@pts/3`"""
    page: str = ""
    """That is in front, in words: `the list`, `panel of arm-1`."""
    robot: str = ""
    """That is selected."""
    since: float = 0.0
    """[s] since 1970."""
    asks: bool = False
    """Whether all others shall say at once that they are there."""
    leaves: bool = False
    heard: str = ""
    """The line that it has just shown, `KEY/NUMBER` (`OperatorSays`): who says it may leave then."""


class OperatorSays(_Message, frozen=True, kw_only=True):
    """A line of an operator to all others, under the key of the program + `/says`, until they have it."""

    person: str
    text: str
    number: int = 0
    """Among the lines of the program: one that comes again is not shown again. 0: nobody waits."""


class StreamSample(_Message, frozen=True, kw_only=True):
    """A robot publishes one value of a stream, under its key + `/stream/NAME`, while somebody listens."""

    value: Any
    """Plain."""


AnyRequest = (
    Describe | Call | Detach | Cancel | Decide | Pause | TakeStep | Continue | Petition | Retract | Renew
    | Attend | SetControl
    | SetPlacement | Disturb
    | Release | SafeStop | Resume | Enslave | Free | Delete | Create | Reload | ReadLog | ReadHistory
    | DescribeHost | Register | Query | Look | DescribeView | WriteEntry | FindEntries | GiveUp | RenewEntry
    | OpenTransaction | CloseTransaction | RollBack | AcquireFence | RenewFence | WatchEntries
    | DescribeSpace | DescribeGateway | ReadBundle
    | Migrate | Drain | PrepareMove | TakeRobot | AskMove
    | ReadEvents | VerifyEvents
    | LeaveOrder | CancelOrder | ConfirmOrder | ReadOrders | MarkSeen | FetchOrders | TakeOrder | TellOrders
    | ReadKnown | TakeAlong | HoldOrders | ReleaseHolds | RobotDeleted | ShareRecords
)  # fmt: skip
Reply = (
    Described | Accepted | Progress | Returned | Granted | HostDescribed | Reloaded | Logged | History
    | Registered | Found | Picture | ViewDescribed | Done | Raised | EntryLeased | EntriesFound
    | TransactionOpened | FenceGranted | EntriesCame | SpaceDescribed | EventsRead | EventsVerified
    | GatewayDescribed | BundleRead
    | OrderLeft | OrdersFound | KnownFound | RecordsShared
    | Moved | MoveReady | MoveDecided
)  # fmt: skip
Published = (
    LogLines | Listed | Unlisted | State | OrdersChanged | StreamSample | OperatorHere | OperatorSays
)  # fmt: skip

_R = TypeVar("_R")
_encoder = msgspec.msgpack.Encoder()
_replies: msgspec.msgpack.Decoder[Reply] = msgspec.msgpack.Decoder(Reply)
_events: msgspec.msgpack.Decoder[Published] = msgspec.msgpack.Decoder(Published)


def encode(message: Reply | Published) -> bytes:
    """Pack a reply or an event; a request needs an envelope, see `envelope.seal`."""
    return _encoder.encode(message)


def decode_reply(body: bytes, *, key: str) -> Reply:
    """Read a reply from `key`.

    Raises:
        Garbled: it is none.
    """
    return _decode(_replies, body, key)


def decode_event(body: bytes, *, key: str) -> Published:
    """Read an event from `key`.

    Raises:
        Garbled: it is none.
    """
    return _decode(_events, body, key)


def _decode(decoder: msgspec.msgpack.Decoder[_R], body: bytes, key: str) -> _R:
    try:
        return decoder.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise Garbled(key=key, detail=str(error)) from None
