"""Virtual robots (nothing to do with goggles): agents that wrap other robots' commands into coarser ones.

What an author of a robot needs can be imported from here. From the bottom up:
`base/` has addresses, values, messages, errors (`base/errors.py`) and the contract of a transport;
`core/` is a robot's state and the rules that change it, without threads and clocks;
`network/` leads to other processes;
`author/` is what a page uses, `exchange/` asks and answers;
`running/` carries out an author's code, `scripts/` are robots made of rules, `lookup/` knows who is where;
`bundle/` loads a page or a script, `world/` runs it all in virtual time, for tests;
`agents/` use all of these, and `supervision/` finds and commands them all by name.
"""

from robotree.vr.author.child import Child, Children, Record
from robotree.vr.author.command import command
from robotree.vr.author.context import CallFuture, CommandContext
from robotree.vr.author.fields import state
from robotree.vr.author.kind import Kind, promised
from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.errors import (
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
from robotree.vr.base.units import Range, Unit

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
