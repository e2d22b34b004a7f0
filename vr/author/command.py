"""Commands: methods of a robot that others may call.

    @command
    def drive(self, length: Annotated[float, Unit("m"), Range(0, 2), "how far"]) -> None:
        "Drive ahead."

A command is plain sequential code and runs in its own thread, one at a time per robot. One that only reads
(`effect="read"`) runs beside the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeVar, get_args, overload

import msgspec

from robotree.vr.author.fields import SET, settings_spec
from robotree.vr.author.robot import Robot, attributes_of
from robotree.vr.author.signature import Command, ResumePolicy, Resumption, signature_of
from robotree.vr.base.description import Effect, Offline
from robotree.vr.base.units import seconds as seconds_of

_F = TypeVar("_F", bound=Callable[..., Any])
_MARK = "__robotree_effect__"
_RESUMPTION = "__robotree_resumption__"
_OFFLINE = "__robotree_offline__"
_ATTENDED = "__robotree_attended__"
_CACHE = "__robotree_commands__"
_HIDING: tuple[type[Any], ...] = (property, staticmethod, classmethod)
"""Decorators that make something else of a method."""


@overload
def command(function: _F, /) -> _F: ...
@overload
def command(
    *,
    effect: Effect = "once",
    resume: ResumePolicy = "continue",
    stale_after: float | str | None = None,
    offline: Offline = "reject",
    attended: bool = False,
) -> Callable[[_F], _F]: ...
def command(
    function: _F | None = None,
    /,
    *,
    effect: Effect = "once",
    resume: ResumePolicy = "continue",
    stale_after: float | str | None = None,
    offline: Offline = "reject",
    attended: bool = False,
) -> _F | Callable[[_F], _F]:
    """Make a method callable by others.

    Args:
        function: the method; its docstring and annotations are what callers see.
        effect: what a repetition does: `read` changes nothing, `repeat` ends the same, `once` adds up.
        resume: what it does when its host has crashed in the middle and is back: `continue` at its next
            step, `restart` from its beginning, `ask` a person, or `abort` with `CommandInDoubt`.
        stale_after: [s] or text with a unit: after a longer absence a person is asked.
        offline: what becomes of it while the robot is away: `reject` refuses it; with `queue` it may be left
            as an order, which the robot carries out when it is back (docs/orders.md); `memory`, for one that
            only reads and needs no arguments: directories answer with its last result.
        attended: it goes on only while somebody attends it at a key: without one for 2 s it is ended, and
            what it has its children do ends with it. A command that has an attended one of a child carried
            out must be attended itself.

    Returns:
        The method, which stays an ordinary method for its own class.

    Raises:
        TypeError: it is no plain method, there is no such way to resume, or none for the absence.
    """
    if offline not in get_args(Offline):
        raise TypeError(f"no offline {offline!r}; write one of {', '.join(get_args(Offline))}")
    if offline == "memory" and effect != "read":
        raise TypeError('offline="memory" is for a command that only reads: effect="read"')
    if attended and effect == "read":
        raise TypeError("a command that only reads needs nobody at a key: take attended away")
    if attended and offline == "queue":
        raise TypeError("an order has nobody at a key: attended and offline='queue' exclude each other")
    if resume not in get_args(ResumePolicy):
        raise TypeError(f"no resume {resume!r}; write one of {', '.join(get_args(ResumePolicy))}")
    resumption = Resumption(resume, math.inf if stale_after is None else seconds_of(stale_after))

    def mark(function: _F) -> _F:
        if isinstance(function, _HIDING):
            raise TypeError(f"a command is a plain method; take @{type(function).__name__} away")
        if not callable(function):
            raise TypeError("a command has the name of its method; write @command without a text")
        if getattr(function, "__name__", "") == "<lambda>":
            raise TypeError("a command is a method with a name; write it with def instead of lambda")
        setattr(function, _MARK, effect)
        setattr(function, _RESUMPTION, resumption)
        setattr(function, _OFFLINE, offline)
        setattr(function, _ATTENDED, attended)
        return function

    return mark if function is None else mark(function)


def is_command(function: Callable[..., Any]) -> bool:
    """Whether a method is marked as a command."""
    return hasattr(function, _MARK)


def commands_of(cls: type[Any]) -> Mapping[str, Command]:
    """Return the commands of a robot's class by name, those of its base classes first.

    Raises:
        TypeError: one is declared in a way that cannot be called from afar.
    """
    known: dict[str, Command] | None = cls.__dict__.get(_CACHE)
    if known is None:
        known = _collect(cls)
        setattr(cls, _CACHE, known)
    return known


def give_commands(cls: type[Any], commands: Mapping[str, Command]) -> None:
    """Say which commands a class has that marks no methods, because it was made from a description."""
    setattr(cls, _CACHE, dict(commands))


def _collect(cls: type[Any]) -> dict[str, Command]:
    found: dict[str, Command] = {}
    for name, value in attributes_of(cls).items():
        if isinstance(value, _HIDING) and (wrapper := _wrapper(value)):
            raise TypeError(f"{cls.__name__}.{name}: a command is a plain method; take @{wrapper} away")
        effect: Effect | None = getattr(value, _MARK, None)
        if effect is None:
            continue
        if name.startswith("_") or hasattr(Robot, name):
            raise TypeError(
                f"{cls.__name__}.{name}: a command cannot have this name; every robot uses it itself"
            )
        resumption = getattr(value, _RESUMPTION, Resumption())
        signature = msgspec.structs.replace(signature_of(value, effect), resumption=resumption)
        offline: Offline = getattr(value, _OFFLINE, "reject")
        if offline == "memory" and any(each.required for each in signature.spec.parameters):
            raise TypeError(f'{cls.__name__}.{name}: offline="memory" is for a command without arguments')
        attended: bool = getattr(value, _ATTENDED, False)
        if offline != "reject" or attended:
            spec = msgspec.structs.replace(signature.spec, offline=offline, attended=attended)
            signature = msgspec.structs.replace(signature, spec=spec)
        found[name] = signature
    spec = settings_spec(cls)
    if spec.parameters:
        if SET in found:
            raise TypeError(
                f"{cls.__name__}.{SET}: a robot with settings has a command of this name itself; rename yours"
            )
        found[SET] = Command(spec, _set, None)
    return found


def _wrapper(value: object) -> str:
    """Return the decorator that hides a command from its callers; empty: there is none."""
    inner = getattr(value, "fget", None) or getattr(value, "__func__", None)
    return type(value).__name__ if hasattr(inner, _MARK) else ""


def _set(robot: Any, **values: Any) -> None:
    """Change settings; the values have been checked."""
    robot.field_values.write(values)
