"""Virtual robots (nothing to do with goggles): agents that wrap other robots' commands into coarser ones.

What an author of a robot needs can be imported from here. From the bottom up:
`base/` has addresses, values, messages, errors (`base/errors.py`) and the contract of a transport;
`core/` is a robot's state and the rules that change it, without threads and clocks;
`network/` leads to other processes;
`author/` is what a page uses, `exchange/` asks and answers;
`running/` carries out an author's code, `scripts/` are robots made of rules, `lookup/` knows who is where,
`space/` keeps the entries that robots share;
`bundle/` loads a page or a script, `world/` runs it all in virtual time, for tests;
`agents/` use all of these, and `supervision/` finds and commands them all by name.

The names are loaded when they are first used (PEP 562): a command line that only asks robots needs none of
them, and this file is read before anything in the folders below it.
"""

TYPE_CHECKING = False
"""As `typing.TYPE_CHECKING`, which would take 5 ms to import."""

if TYPE_CHECKING:
    from robotree.vr.author.child import Child, Children
    from robotree.vr.author.command import command
    from robotree.vr.author.context import CallFuture, CommandContext, StepInDoubt
    from robotree.vr.author.fields import state
    from robotree.vr.author.kind import Kind, promised
    from robotree.vr.author.readings import Record
    from robotree.vr.author.retry import retry
    from robotree.vr.author.robot import Robot
    from robotree.vr.author.signature import Within
    from robotree.vr.author.stream import Stream
    from robotree.vr.author.virtual_robot import Service, VirtualRobot
    from robotree.vr.author.watch import Watch
    from robotree.vr.base.errors import (
        BadArgument,
        ChildCancelled,
        ChildTimeout,
        CommandCancelled,
        CommandError,
        CommandFailed,
        CommandInDoubt,
        DeadlineExceeded,
        EmptyRealm,
        Failed,
        NoSuchRobot,
        NotInControl,
        NotThisKind,
        SlotEmpty,
        Stopped,
        VrError,
    )
    from robotree.vr.base.units import Range, Unit

__all__ = [
    # a robot
    "Robot",
    "VirtualRobot",
    "Service",
    "Child",
    "Children",
    "Watch",
    "Stream",
    "state",
    "Kind",
    "promised",
    "Within",
    # its commands
    "command",
    "Unit",
    "Range",
    # inside of them
    "CallFuture",
    "CommandContext",
    "StepInDoubt",
    "Record",
    "retry",
    # what can go wrong
    "VrError",
    "CommandError",
    "Failed",
    "BadArgument",
    "CommandCancelled",
    "ChildCancelled",
    "ChildTimeout",
    "CommandFailed",
    "CommandInDoubt",
    "DeadlineExceeded",
    "SlotEmpty",
    # and for programs that join a realm
    "EmptyRealm",
    "NoSuchRobot",
    "NotThisKind",
    "NotInControl",
    "Stopped",
]

_FROM = {
    "author.child": ("Child", "Children"),
    "author.command": ("command",),
    "author.context": ("CallFuture", "CommandContext", "StepInDoubt"),
    "author.fields": ("state",),
    "author.kind": ("Kind", "promised"),
    "author.readings": ("Record",),
    "author.retry": ("retry",),
    "author.robot": ("Robot",),
    "author.signature": ("Within",),
    "author.stream": ("Stream",),
    "author.virtual_robot": ("Service", "VirtualRobot"),
    "author.watch": ("Watch",),
    "base.units": ("Range", "Unit"),
}
"""Which module a name comes from; all others are errors."""


def __getattr__(name: str) -> object:
    """Load a name that is used for the first time."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    module = next((module for module, names in _FROM.items() if name in names), "base.errors")
    found = globals()[name] = getattr(import_module(f"{__name__}.{module}"), name)
    return found


def __dir__() -> list[str]:
    """Return the names that can be imported."""
    return sorted({*globals(), *__all__})
