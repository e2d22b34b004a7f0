"""One line of the history of a robot: what was asked, accepted, begun, answered. Pure."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

EventKind = Literal["accepted", "ended", "answered", "lease", "stop", "observed", "back", "moved", "missed"]
"""accepted: a robot has taken a call. ended: that call is over. answered: a parent has heard how the call of
its child in another process ended. lease: somebody commands the robot from now on, or nobody. stop: it is
stopped. observed: a running command has read something. back: its
host had ended, and a command of the robot goes on. moved: it has come from another host, has not left for
one, or it is not known which; of each command that goes on, or of none. missed: events that were not kept."""


class HistoryEvent(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One event. Calls that only read are not kept."""

    kind: EventKind
    unix: float
    """[s] since 1970, on the clock of the robot's host: when it happened."""
    robot: str
    """The name of the robot whose event it is."""
    key: str = ""
    """Of the call: `command id / step / …`, so what precedes a slash is the key of what has called it."""
    command: str = ""
    arguments: Any = None
    """As they came."""
    caller: str = ""
    """Name of the robot, or of the person, `anna@pts/3`, that called."""
    person: str = ""
    """The person at the terminal from which it was asked; empty: a robot asks."""
    process: int = 0
    """Number of the process that asked, on its machine."""
    epoch: int = 0
    """Of the lease under which it was asked; 0: under none."""
    parent: str = ""
    """The holder of the lease."""
    page: str = ""
    """Hash of the page of the robot that carries it out; empty: it has none."""
    line: int = 0
    """Line of the caller's page at which it was called; 0: not known."""
    within: float = 0.0
    """[s] that it may take."""
    began: float = 0.0
    """[s] since 1970 when its turn came; 0: never."""
    error: str = ""
    """Class of the error with which it ended; empty: it ended well."""
    value: Any = None
    """Its result, or the data of the error; what an observation has read."""
    text: str = ""
    """For people: why a call was asked for and who allowed it, why a lease ended, why it is stopped, how many
    events are missing and why."""


class NumberedEvent(msgspec.Struct, frozen=True):
    """An event, and where it stands in its file."""

    number: int
    event: HistoryEvent
