"""A step of which nobody knows whether it was carried out: who is asked, one after the other.

    the child, in another process or under another lease, if something remembers commands for it, such as a
    controller
    `verify` of the page
    the page, if it catches `CommandInDoubt` where it waits: the error is raised there
    a person: `robotree decide NAME done|again|abort`

What adds up (`effect="once"`) is not done again before one of them has said that it was not done. All this
happens on a worker of its own, while the command waits for the step.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol, TypeVar

from robotree.vr.author.context import CommandContext, StepInDoubt
from robotree.vr.author.robot import Robot
from robotree.vr.base.address import Address
from robotree.vr.base.errors import CommandInDoubt, EndedInDoubt, VrError
from robotree.vr.base.readable import quantity
from robotree.vr.base.requests import Raised, Returned
from robotree.vr.core.bonds import RETURN
from robotree.vr.running.catching import catches
from robotree.vr.running.feed import Feeds
from robotree.vr.running.frame import Frame
from robotree.vr.running.ice import GoneOn
from robotree.vr.running.process import Worker
from robotree.vr.running.replay import Intent, words_of_step
from robotree.vr.running.robot_runtime import RobotRuntime

LOOKS = 0.05
"""[s] between two looks whether another process of the child is there."""
NEWS = 1.5
"""[s] in which a child publishes its readings."""
MOST_READINGS = 8
"""Readings that a question shows."""
ANSWERS = "Was it done? done: go on after it, without doing it; again: do it now; abort: end the command here"
"""What a person is asked at the end of a question."""

T = TypeVar("T")
_log = logging.getLogger(__name__)


class Asker(Protocol):
    """The part of a command that finds out: an `activity.CommandActivity`."""

    runtime: RobotRuntime
    context: CommandContext
    keeps: bool

    @property
    def cancelled(self) -> bool:
        """Whether it has been asked to end."""
        ...

    @property
    def feeds(self) -> Feeds:
        """The readings of children that it follows."""
        ...

    def now(self) -> float:
        """Return the time [s] on a monotonic clock."""
        ...

    def wait(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait until something is so, or for `timeout` [s]; returns whether it is."""
        ...

    def carry_out(self, work: Callable[[], T]) -> tuple[T | None, BaseException | None]:
        """Carry the page's code out; returns its value or its error."""
        ...

    def ask_person(self, question: str) -> str:
        """Ask a person, and wait for the answer: `done`, `again` or `abort`."""
        ...

    def end(self) -> None:
        """End what it has opened."""
        ...


class DoubtfulCall(Protocol):
    """The call of a child whose result is lost: a `child_call.ChildCall`."""

    frame: Frame
    slot: str
    key: str
    child: Address
    command: str
    arguments: Mapping[str, Any]
    intent: Intent | None
    """To whom it was given, if that is kept."""
    asked_at: str
    """Key of the child that was asked last; empty: its lease was lost, so the same one may know."""

    def asking_part(self, worker: Worker) -> Asker:
        """Return the part of its command that finds out."""
        ...

    def conclude(self, reply: Returned | Raised) -> None:
        """Take how it ended, for good."""
        ...

    def repeat(self) -> None:
        """Call the child again, under another key: it was not carried out."""
        ...

    def ask_elsewhere(self) -> None:
        """Ask the child that is there now whether it was carried out."""
        ...


def is_settled_here(call: DoubtfulCall, raised: Raised) -> bool:
    """Whether an error leaves a step of a page in doubt, and somebody can be asked here."""
    if raised.error != CommandInDoubt.__name__ or raised.data.get("robot") != call.child.name:
        return False  # of a robot further down: it was asked about there
    frame = call.frame
    verifies = type(frame.runtime.robot).verify is not Robot.verify
    return (frame.keeps or verifies) and frame.runtime.witness_of(call.slot, call.command) is not None


def settle(call: DoubtfulCall, doubt: Raised, worker: Worker) -> None:
    """Find out whether a step was carried out, and end its call or make it again."""
    part = call.asking_part(worker)
    outcome: Returned | Raised | Callable[[], None] = doubt
    try:
        outcome = _outcome(call, doubt, part)
    except GoneOn:  # its robot goes on in another process, which finds it out again
        part.end()
        return
    except VrError as error:  # its command was ended meanwhile
        _log.debug("%s: %s", call.key, error)
    except Exception:  # noqa: BLE001 # the page must hear of it in any case
        _log.exception("%s: nobody could be asked", call.key)
    part.end()
    if callable(outcome):
        outcome()
    else:
        call.conclude(outcome)


def _outcome(call: DoubtfulCall, doubt: Raised, part: Asker) -> Returned | Raised | Callable[[], None]:
    """Return how a step has ended, or what is to be done about it."""
    if _is_remembered(call, part):
        return call.ask_elsewhere
    detail = str(doubt.data.get("detail", ""))
    step = StepInDoubt(call.slot, call.command, call.arguments, detail)
    known, error = part.carry_out(partial(part.runtime.robot.verify, step))
    if error is not None:
        if part.cancelled:
            return doubt
        part.runtime.log.say("warning", f"verify has failed, so it does not count: {error}")
        known = None
    if known is not None:
        return Returned(key=call.key) if known else call.repeat
    if not part.keeps or catches(call.frame, CommandInDoubt):
        return doubt
    return _asked(call, part, detail)


def _is_remembered(call: DoubtfulCall, part: Asker) -> bool:
    """Wait for a child that has not been asked yet; whether it can know what was begun before."""
    intent, runtime = call.intent, part.runtime
    if intent is None or not intent.witness:
        return False

    def decided() -> bool | None:
        bond = runtime.find_bond(call.slot)
        if bond is not None and bond.child.key == call.asked_at:
            return False
        return True if bond is not None and bond.description.witness else None

    restarted = call.frame.run.recall is not None
    returns = runtime.look(lambda state: state.slots[call.slot].spec.returns)
    until = part.now() + max(RETURN if restarted else 0.0, returns)
    while (found := decided()) is None and part.now() < until:
        part.wait(lambda: decided() is not None, LOOKS)
    return bool(found)


def _asked(call: DoubtfulCall, part: Asker, detail: str) -> Returned | Raised | Callable[[], None]:
    """Have a person answer; "again" without a child in the slot is asked about anew."""
    label, refused = f"{call.child.name}.{call.command}", ""
    fields = part.runtime.child_parameters(call.slot, call.command)
    step = words_of_step("call", [call.child.name, call.command, call.arguments], fields)
    while True:
        question = (
            f"{refused}{step} may have been carried out or not ({detail}); {_look(call, part)}. {ANSWERS}"
        )
        answer, error = part.carry_out(partial(part.ask_person, question))
        if error is not None:
            raise error
        if answer == "done":
            return Returned(key=call.key)
        if answer != "again":
            break
        if part.runtime.find_bond(call.slot) is not None:
            return call.repeat
        name = f"{part.runtime.name}.{call.slot}"
        refused = f"nothing was done: {name} is empty, `robotree enslave {name} {call.child.name}` first; "
    reason = f"{detail}; a person has ended {part.runtime.name}.{part.context.command}"
    part.runtime.log.say("warning", f"{label} stays in doubt")
    return Raised.of(EndedInDoubt(robot=call.child.name, command=call.command, detail=reason))


def _look(call: DoubtfulCall, part: Asker) -> str:
    """Return what the child reads, how old that is, and which views show it, in words."""
    name, runtime = call.child.name, part.runtime
    try:
        feed = part.feeds.of(call.slot)
        part.wait(lambda: feed.state is not None, NEWS)
        units = runtime.bond_in(call.slot).description.units
    except VrError as error:
        seen = f"nothing is heard of {name}: {error}"
    else:
        readings = {} if feed.state is None else dict(feed.state.readings)
        age = readings.pop("age", 0.0)
        shown = [
            f"{reading} {quantity(value, units.get(reading, ''))}"
            for reading, value in list(readings.items())[:MOST_READINGS]
        ]
        seen = f"{name} reads {', '.join(shown)}, {age:.1f} s ago" if shown else f"{name} reads nothing"
    views = [key.split("/")[1] for key in runtime.present("view")]
    return f"{seen}; picture: `robotree look {min(views)}`" if views else seen
