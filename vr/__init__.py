"""Virtual robots (nothing to do with goggles): agents that wrap other robots' commands into coarser ones.

What an author of a robot needs is here, in pure files; every error is in `errors.py`. From the bottom up:
`core/` is a robot's state and the rules that change it, without threads and clocks;
`running/` carries out an author's code, `roles/` changes its manner, `scripts/` are robots made of rules,
`bundle/` loads a page or a script, `network/` leads to other processes;
`exchange/` asks and answers, `lookup/` knows which agent is where, `agents/` use all of these,
`supervision/` finds and commands them all by name, and `world/` runs it all in virtual time, for tests.
"""

from robotree.vr.child import Child, Children, Record
from robotree.vr.command import command
from robotree.vr.context import CallFuture, CommandContext
from robotree.vr.errors import (
    BadArgument,
    ChildCancelled,
    CommandCancelled,
    CommandError,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    Failed,
    SlotEmpty,
    VrError,
)
from robotree.vr.fields import state
from robotree.vr.kind import Kind, promised
from robotree.vr.robot import Robot
from robotree.vr.units import Range, Unit
from robotree.vr.virtual_robot import VirtualRobot

__all__ = [
    # a robot
    "Robot",
    "VirtualRobot",
    "Child",
    "Children",
    "state",
    "Kind",
    "promised",
    # its commands
    "command",
    "Unit",
    "Range",
    # inside of them
    "CallFuture",
    "CommandContext",
    "Record",
    # what can go wrong
    "VrError",
    "CommandError",
    "Failed",
    "BadArgument",
    "CommandCancelled",
    "ChildCancelled",
    "CommandFailed",
    "CommandInDoubt",
    "DeadlineExceeded",
    "SlotEmpty",
]
