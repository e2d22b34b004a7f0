"""The events of a robot, and its effects: plain values that name things by key."""

from __future__ import annotations

from typing import Any

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import ANSWER_WITHIN, Call, Done, Raised, Returned
from robotree.vr.core.bonds import Bond
from robotree.vr.core.placement import Placing


class _Value(msgspec.Struct, frozen=True, kw_only=True, tag=True, omit_defaults=True):
    """One event or one effect."""


class StepResult(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """The result of one step of a running command: enough to take it again without doing anything twice."""

    kind: str
    """`call`, `tell`, `sleep`, `wait`, `look`, `reading`, `sample`, `until`, `group`, `result`, `field`,
    `cleanup`, `end`, `space`, `move`."""
    content: Any = None
    """Its content, which differs from another step's: of a call its slot, command and arguments."""
    value: Any = None
    """Its result, as plain data."""
    reply: Returned | Raised | None = None
    """Of a call: how it ended."""


END = "!"
"""Path and kind of the mark where the end of a command was raised in its code, after so many steps."""
BEGUN = "~"
"""End of the path under which a step keeps whom it was given, while it is not known how it ends."""
THREAD = "thread"
"""Path and kind of the step with which a command uses a thread of its author's own: it cannot go on."""

RECEIVED, AT = "received", "at"
"""Kind of the steps that keep what came from outside, and the name under which these say when [s]."""
MOMENTS = ("sleep", "cleanup")
"""Kinds of steps whose value is a moment [s] on the robot's clock."""


class _Event(_Value, frozen=True, kw_only=True):
    principal: Principal = ITSELF
    """Its asker."""


# -- events: calls ---------------------------------------------------------------------------------


class Invoke(_Event, frozen=True, kw_only=True):
    """Somebody calls a command, whose arguments have been checked."""

    call: Call
    """As it came."""
    arguments: dict[str, Any]
    """As checked."""
    deadline_at: float
    """[s] on the robot's clock."""
    reads: bool = False
    stops_seen: int = -1
    """Stops that the robot had received when the call came; -1: not checked."""
    alone: bool = False
    """It is refused while another call of the same command runs or waits."""
    attended: bool = False
    """It goes on only while somebody attends it."""
    attended_until: float = 0.0
    """[s] on the robot's clock, until when somebody does; 0: nobody."""


class Attended(_Event, frozen=True, kw_only=True):
    """Somebody at a key attends a call: `requests.Attend`."""

    key: str
    """Of the call."""
    at: float
    """[s] on the robot's clock, when the key was pressed."""


class ControlAsked(_Event, frozen=True, kw_only=True):
    """An operator wants to get, ask for, offer, take or leave control: `requests.SetControl`."""

    what: str
    unix: float
    """[s] since 1970."""
    person: str = ""
    within: float = 0.0
    seen: int = -1


class OperatorGone(_Event, frozen=True, kw_only=True):
    """The program of an operator has gone who has control, or asks for it."""

    agent: str
    unix: float
    """[s] since 1970."""


class Finish(_Event, frozen=True, kw_only=True):
    """The code of a call has ended."""

    key: str
    reply: Returned | Raised


class StepTaken(_Event, frozen=True, kw_only=True):
    """A running command has taken a step."""

    key: str
    """Of the call."""
    path: str
    """Of the step: what follows the call's key in the key of the step."""
    step: StepResult


class Checkpoint(_Event, frozen=True, kw_only=True):
    """A running command needs the steps of this round no more: interrupted, it goes on from here.

    What it needs to come here once more is kept: the steps up to the first checkpoint at this place.
    """

    key: str
    """Of the call."""
    place: str = ""
    """Where in its page it is made; empty: at its beginning, none of its steps is needed."""


class DoubtRaised(_Event, frozen=True, kw_only=True):
    """A running command cannot go on before a person has answered."""

    key: str
    """Of the call."""
    question: str


class DoubtSettled(_Event, frozen=True, kw_only=True):
    """A person answers what a command has asked."""

    answer: str
    """`done`, `again` or `abort`."""
    epoch: int | None = None
    """Of the asker's lease."""


class DetachAsked(_Event, frozen=True, kw_only=True):
    """A call goes on without the command that made it: see `machine.AcceptedCall.detached`."""

    key: str
    epoch: int | None = None
    """Of the asker's lease."""


class CancelAsked(_Event, frozen=True, kw_only=True):
    """End one call, also one that has not come yet."""

    key: str
    reason: str
    epoch: int | None = None
    """Of the asker's lease."""
    final: bool = False
    """Whether not even a clean-up may command children any more."""


class CancelAll(_Event, frozen=True, kw_only=True):
    """End all calls."""

    reason: str
    but_readers: bool = False
    epoch: int | None = None
    """Of the asker's lease."""
    final: bool = False
    """Whether not even a clean-up may command children any more; so it is in any case for a call that was
    asked to end before."""


class Abandon(_Event, frozen=True, kw_only=True):
    """The code of a call ignores its end: give it up."""

    key: str
    where: str = ""
    """The line of its page that is at work, in words."""


class Gone(_Event, frozen=True, kw_only=True):
    """Abandoned code has ended after all."""

    key: str


class Tick(_Event, frozen=True, kw_only=True):
    """Time has passed: what is due ends."""

    unix: float
    """[s] since 1970."""


# -- events: who commands it -----------------------------------------------------------------------


class ParentAsked(_Event, frozen=True, kw_only=True):
    """A parent petitions for the lease."""

    parent: Address
    slot: str
    lineage: tuple[str, ...]
    term: float
    unix: float
    key: str = ""
    returns: int | None = None
    """Epoch of the lease that it has lost by silence; 0: it has lost an earlier incarnation of this robot."""
    patience: float = 0.0
    """[s] after its end in which that lease shall return; 0: as long as usual."""
    waits: float = 0.0
    """[s] that the robot is to wait for a parent whose process has ended; 0: it does not."""
    life: int = 0
    """How often the parent's process was started with its journal; 0: it keeps none."""
    idle: bool = False
    """It is refused unless nothing runs or waits here, and no stop is in force."""


class ParentAway(_Event, frozen=True, kw_only=True):
    """The parent's process has ended, and it keeps a journal: it may come back."""

    parent: Address


class Prolong(_Event, frozen=True, kw_only=True):
    """The parent renews the lease."""

    parent: Address
    epoch: int
    lineage: tuple[str, ...]
    paused: str = ""
    """The one who has paused it, for people; empty: nobody."""
    pauses: int = 0
    """How often that has changed."""
    life: int = 0
    """How often the parent's process was started with its journal; 0: it keeps none."""
    heir: str = ""
    """See `bonds.Lease.heir`."""
    proof: str = ""
    """Shown by the process in which the parent goes on after a move: see `bonds.proof_of`."""
    is_there: bool = True
    """Whether it is present; else its process has ended since it asked, and its next one is its heir."""
    unix: float = 0.0
    """[s] since 1970."""


class EndLease(_Event, frozen=True, kw_only=True):
    """The lease of a parent ends: released, retracted, or because the parent is gone."""

    parent: Address
    unix: float
    reason: str
    epoch: int | None = None
    """Of the lease; None: whichever the parent has."""
    taken_back: bool = False
    """Whether a petition is taken back, also before it comes."""
    petition: str = ""
    """Its key."""


class Obeyed(_Event, frozen=True, kw_only=True):
    """The controller behind the robot obeys an epoch."""

    epoch: int


# -- events: the robots that it commands -----------------------------------------------------------


class Reserve(_Event, frozen=True, kw_only=True):
    """A child is being asked to come into a slot."""

    slot: str
    child: Address


class Unreserve(_Event, frozen=True, kw_only=True):
    """It does not come."""

    slot: str


class Bind(_Event, frozen=True, kw_only=True):
    """It comes."""

    slot: str
    bond: Bond


class FreeAsked(_Event, frozen=True, kw_only=True):
    """The child in a slot is released."""

    slot: str


class Watching(_Event, frozen=True, kw_only=True):
    """A robot is watched in a slot from now on, or its next life."""

    slot: str
    robot: Address


class WatchEnded(_Event, frozen=True, kw_only=True):
    """Nobody is watched in a slot any more."""

    slot: str


class Lose(_Event, frozen=True, kw_only=True):
    """The child in a slot is lost."""

    slot: str
    child: Address
    epoch: int
    reason: str


class Renewed(_Event, frozen=True, kw_only=True):
    """The child in a slot has prolonged its lease."""

    slot: str
    child: Address
    epoch: int
    sent: float
    """[s] The time in the effect `RenewLease`."""
    term: float
    depth: int = 0
    ways: float = 0.0
    description: RobotDescription | None = None
    """If it has changed."""
    stopped: int = 0
    """See `bonds.Lease.stopped`."""
    granted: int = -1
    """The epoch from now on: it grows with each process of the parent; -1: it stays."""


class ChildDescribed(_Event, frozen=True, kw_only=True):
    """The child in a slot has sent its description again."""

    slot: str
    child: Address
    epoch: int
    description: RobotDescription


# -- events: what it keeps -------------------------------------------------------------------------


class Set(_Event, frozen=True, kw_only=True):
    """Settings or declared state have other values, which have been checked."""

    values: dict[str, Any]
    epoch: int | None = None
    """Of the asker's lease."""


class PageReloaded(_Event, frozen=True, kw_only=True):
    """Another page carries out what comes from now on; no command that moves runs at the moment."""

    slots: tuple[SlotSpec, ...]
    """The slots that the page declares."""
    fields: dict[str, Any]
    """Its settings and its state, with their values."""


# -- events: stops ---------------------------------------------------------------------------------


class StopAsked(_Event, frozen=True, kw_only=True):
    """A protective stop is ordered, or a copy of an order comes."""

    reason: str
    order: str = ""
    within: float = ANSWER_WITHIN
    """[s] in which its parts are to answer."""


class PauseAsked(_Event, frozen=True, kw_only=True):
    """From now on each command waits before its next step."""

    by: str
    """The one who orders it, for people."""


class StepLet(_Event, frozen=True, kw_only=True):
    """One step may pass though the robot is paused."""

    step: str
    """Its key; empty: none waits."""
    epoch: int | None = None
    """Of the asker's lease."""


class ContinueAsked(_Event, frozen=True, kw_only=True):
    """The pause ends."""


class PlacingSet(_Event, frozen=True, kw_only=True):
    """How it is moved, or why it is where it is, has changed."""

    placing: Placing


class Restored(_Event, frozen=True, kw_only=True):
    """The robot goes on from its encoded state: who carried out effects before has ended."""

    calls: tuple[str, ...] = ()
    """Keys of the calls that ran then: their code begins again."""
    gap: float = 0.0
    """[s] for which the robot was away."""
    came: bool = False
    """Whether it has come from another host: no process has ended."""


class Halted(_Event, frozen=True, kw_only=True):
    """The robot itself reports that it is stopped, or that it no longer is."""

    reason: str


class StopAnswered(_Event, frozen=True, kw_only=True):
    """A part of the robot has answered a stop: `HARDWARE`, or the child in a slot for all below it."""

    generation: int
    part: str
    answer: Done | Raised


class ReleaseAsked(_Event, frozen=True, kw_only=True):
    """All below are released: the stop ends, if no later one has begun."""

    generation: int


CoreEvent = (
    StepTaken | Checkpoint | DoubtRaised | DoubtSettled | ParentAway | Invoke | Finish
    | Attended | ControlAsked | OperatorGone
    | DetachAsked | CancelAsked | CancelAll | Abandon | Gone | Tick | ParentAsked
    | Prolong | EndLease | Obeyed | Reserve | Unreserve | Bind | FreeAsked | Lose | Renewed
    | Watching | WatchEnded
    | ChildDescribed | Set | PageReloaded | StopAsked | Halted | Restored | StopAnswered | ReleaseAsked
    | PauseAsked | StepLet | ContinueAsked | PlacingSet
)  # fmt: skip


# -- effects ---------------------------------------------------------------------------------------


class Begin(_Value, frozen=True, kw_only=True):
    """Carry out the call of a key."""

    key: str


class Interrupt(_Value, frozen=True, kw_only=True):
    """End the code of a call."""

    key: str
    cause: Raised
    final: bool = False
    """Whether not even its clean-up may command children any more."""


class Decided(_Value, frozen=True, kw_only=True):
    """A person has answered what the command of a key has asked."""

    key: str
    answer: str


class Ended(msgspec.Struct, frozen=True):
    """One call that is over: what is answered when it is asked again, and what its line in the log says."""

    key: str
    command: str
    sent: dict[str, Any]
    """Its arguments, as they came."""
    reply: Returned | Raised
    source: str
    number: int
    caller: str
    reads: bool
    came: float
    """[s] on the robot's clock, when it was accepted."""
    began: float
    """[s] when its turn came; below 0: never."""
    ended: float


class Settled(_Value, frozen=True, kw_only=True):
    """A call has ended: notify its listeners."""

    key: str
    reply: Returned | Raised
    call: Ended | None = None
    """None: it had ended before, and is asked again."""


class LeaseGranted(_Value, frozen=True, kw_only=True):
    """The parent that has asked holds the lease from now on, or still."""

    epoch: int
    term: float
    """[s]"""
    depth: int
    """Levels of robots below this one."""
    ways: float
    """[s] that the ways down through these levels and back take together, as measured."""
    stopped: int = 0
    """See `bonds.Lease.stopped`."""


class StopTaken(_Value, frozen=True, kw_only=True):
    """A stop is in force."""

    generation: int
    """Its number: how many stops there are with it."""
    fresh: bool
    """Whether it is a new one; else a copy of an order that came before."""
    reply: Done | Raised | None
    """The answer, if all parts have answered already."""


class AttentionPassed(_Value, frozen=True, kw_only=True):
    """Somebody attends a running command, and so what it has its children do."""

    key: str
    """Of the call."""
    at: float
    """[s] as in `Attended`."""


class ControlChanged(_Value, frozen=True, kw_only=True):
    """Another operator has control, asks for it, or is offered it, or nobody any more."""

    agents: frozenset[str] = frozenset()
    """Keys under which those must be present who have it or ask for it."""
    text: str = ""
    """What happened, for the log; empty: nothing that is to be told."""


class LeaseChanged(_Value, frozen=True, kw_only=True):
    """Somebody else commands the robot, or the lease has other ancestors."""


class LeaseEnded(_Value, frozen=True, kw_only=True):
    """Nobody commands the robot any more."""

    parent: Address
    slot: str
    reason: str


class RenewLease(_Value, frozen=True, kw_only=True):
    """Ask the child in a slot to prolong its lease, now."""

    slot: str
    child: Address
    epoch: int
    sent: float
    """[s] From when its answer counts."""


class ChildGone(_Value, frozen=True, kw_only=True):
    """A slot is empty again: end the calls of the child that was in it."""

    slot: str
    child: Address
    reason: str
    """Why it was lost; empty: it was released."""
    epoch: int = 0
    """Of the lease that is over."""


class AskPart(_Value, frozen=True, kw_only=True):
    """Ask a part of the robot to confirm a stop, unless it is being asked; it answers by `StopAnswered`."""

    generation: int
    part: str
    reason: str
    order: str
    within: float
    """[s] in which it is to answer."""


class StopSettled(_Value, frozen=True, kw_only=True):
    """All parts have answered a stop: reply to those who wait for it."""

    generation: int
    reply: Done | Raised


class PauseChanged(_Value, frozen=True, kw_only=True):
    """Commands that wait before a step look again whether it may pass."""


class FieldsChanged(_Value, frozen=True, kw_only=True):
    """Settings or declared state have other values: those who look at the robot are to see them."""


CoreEffect = (
    ControlChanged | AttentionPassed
    | Begin | Decided | Interrupt | Settled | LeaseGranted | LeaseChanged | LeaseEnded
    | RenewLease | ChildGone
    | FieldsChanged | PauseChanged | AskPart | StopTaken | StopSettled
)  # fmt: skip
