"""A permit: a person's yes to exactly one call of an assistant. Pure.

Where the policy says `ask`, a call becomes a permit that waits, without any open request, until a person has
answered. The yes is bound to that call: to the assistant, the robot in its present life, the command and its
arguments, for a while and once; and no stop may have come since the call was asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal, NamedTuple

import msgspec
from msgspec.structs import replace

from robotree.vr.base.foreign import bounded

PermitState = Literal["waits", "allowed", "denied", "begun", "over", "withdrawn"]
"""waits: nobody has answered. allowed: a person has said yes, and it has not begun. denied: a person has said
no. begun: the call was sent to the robot with it. over: that call has ended. withdrawn: the assistant does
not want it any more."""

WAITS: Final = 3600.0
"""[s] for which a permit waits for an answer."""
GOOD: Final = 300.0
"""[s] for which a yes is good: then the call must have begun."""
LONGEST_GIVEN: Final = 1000
"""[characters] of one argument as people are shown it."""
REMEMBERED: Final = 7 * 24 * 3600.0
"""[s] for which what became of a permit can be looked up."""


class PermittedCall(NamedTuple):
    """A call as the robot that is asked sees it."""

    permit: str
    life: str
    """Key of the robot in its present life; empty: not known."""
    stops: int
    """How many stops of the robot have begun."""
    command: str
    arguments: Mapping[str, Any]
    key: str
    vouched: Permit | None = None
    """The permit, as the gateway vouches for it; None: the robot reads it from the realm's folder."""


class Permit(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One call that a person is asked about, and what became of it."""

    id: str
    assistant: str
    robot: str
    """Its name, for people."""
    life: str
    """Key of the robot in its present life: a robot that was made anew is another one."""
    stops: int
    """How many stops of the robot had begun when it was asked for."""
    below: dict[str, tuple[str, int]] = {}
    """The same two of each robot below it, by name; ("", -1): it could not be asked."""
    command: str
    arguments: dict[str, Any] = {}
    """As the robot's command takes them: numbers in the declared units."""
    units: dict[str, str] = {}
    """Symbol of the unit of each argument that has one."""
    within: float = 60.0
    """[s] that the command may take."""
    why: str = ""
    """What the assistant says why, in its own words."""
    preview: tuple[str, ...] = ()
    """What it would do, line by line: see `assistants/preview.py`."""
    path: tuple[tuple[float, float, float], ...] = ()
    """[m] the way of the preview."""
    picture: str = ""
    """File name of the last picture, beside the permit; empty: none."""
    asked: float
    """[s] since 1970."""
    state: PermitState = "waits"
    by: str = ""
    """Who has answered, `anna@pts/3`."""
    answered: float = 0.0
    """[s] since 1970."""
    key: str = ""
    """Of the call that has begun with it."""
    outcome: str = ""
    """How that call has ended, as a sentence."""

    def until(self) -> float:
        """[s] since 1970 at which it is of no use any more; infinite: it is over."""
        if self.state == "waits":
            return self.asked + WAITS
        return self.answered + GOOD if self.state in {"allowed", "begun"} else float("inf")

    def expired(self, now: float) -> bool:
        """Whether it waits, or is allowed, for too long [now in s since 1970], or the clock was put back."""
        return now >= self.until() or now < self.asked - GOOD

    @property
    def given(self) -> str:
        """The arguments for people, on one line: `x=0.3 m, to=«the shelf»`."""
        return ", ".join(
            f"{bounded(name, 80)}={_given(value)}"
            f"{' ' + bounded(self.units[name], 20) if name in self.units else ''}"
            for name, value in self.arguments.items()
        )

    @property
    def call(self) -> str:
        """The call for people: `arm-1.go_to(x=0.3 m)`."""
        return f"{self.robot}.{self.command}({self.given})"


def _given(value: Any) -> str:
    """Return one argument as people are shown it; one that is not shown whole says so."""
    told = str(value)
    shown = bounded(told, LONGEST_GIVEN)
    left_out = "" if shown == told else f" (not shown as it is: {len(told)} characters)"
    return (f"«{shown}»" if isinstance(value, str) else shown) + left_out


def travelling(permit: Permit) -> Permit:
    """Return what a robot of another site has to know of a permit: all but what a person was shown."""
    return replace(permit, preview=(), path=(), picture="", why="", units={}, below={})


def on_clock(permit: Permit, ahead: float) -> Permit:
    """Return a permit on this machine's clock; that of the site where it was given is `ahead` [s]."""
    return replace(permit, asked=permit.asked - ahead, answered=permit.answered - ahead)


def unfit(permit: Permit, assistant: str, call: PermittedCall, now: float) -> str:
    """Return why a permit does not allow a call, as a clause; empty: it does.

    Args:
        permit: which.
        assistant: that calls.
        call: what the robot is asked; its key is that with which the permit has begun.
        now: [s] since 1970.
    """
    if permit.id != call.permit:
        return f"it is {permit.id}"
    if permit.assistant != assistant:
        return f"it is {permit.assistant}'s"
    if permit.state != "begun" or permit.key != call.key:
        return f"it was used for another call, or for none ({permit.state})"
    return unlike(permit, call) or ("it has expired" if permit.expired(now) else "")


def unlike(permit: Permit, call: PermittedCall) -> str:
    """Return in what a call is not the one that a permit is for, as a clause; empty: in nothing."""
    if permit.life != call.life:
        return f"it is for {permit.life}, and this is {call.life or 'a robot whose life is not known here'}"
    if permit.stops != call.stops:
        return "the robot was stopped since it was asked for"
    if permit.command != call.command:
        return f"it is for {permit.command}, and this is {call.command}"
    if not same(permit.arguments, call.arguments):
        return f"it is for the arguments {permit.given or 'none'}"
    return ""


def is_same_call(permit: Permit, other: Permit) -> bool:
    """Whether a permit that has not begun is for the call for which another one would be."""
    return (
        permit.state in {"waits", "allowed"}
        and _call_of(permit) == _call_of(other)
        and same(permit.arguments, other.arguments)
    )


def _call_of(permit: Permit) -> tuple[object, ...]:
    return (
        *(permit.assistant, permit.robot, permit.life, permit.stops),
        *(permit.below, permit.command, permit.within),
    )


def same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether arguments are equal, whatever the order in which they stand."""
    encode = msgspec.json.Encoder(order="deterministic").encode
    return encode(dict(one)) == encode(dict(other))
