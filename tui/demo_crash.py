"""The demo of a crash: the host of the lever's robots is killed while they close it, and the lever closes.

The crew of the demo starts the host again; its robots come back and their command goes on at its next step.
What came of it is counted where it happens: the controller writes down each goal that it begins, the arm's
proxy each call that it has accepted, and the host each answer that a page has got.
"""

from __future__ import annotations

import asyncio
import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from robotree.tui.demo import ARM, CELL, HOST, LEVER, MOVER, VIEW, Course, Tell, build_lever
from robotree.tui.line.past import kept_events
from robotree.tui.processes.programs import programs
from robotree.vr.base.errors import CommandInDoubt, VrError
from robotree.vr.base.requests import ReadEvents

if TYPE_CHECKING:
    from robotree.vr.base.history_event import HistoryEvent
    from robotree.vr.supervision.realm_client import RealmClient

CONTROLLER = "table"
AT = (3, 9)
"""Goals of the command that the controller has begun when the host is killed."""
CLOSED = 0.75
"""[rad] from where on the lever is closed."""
LONGEST = 180.0
"""[s] that the command may take."""
SETTLES = 5.0
"""[s] in which all that has happened stands in the histories."""
LOOKS = 0.02
"""[s] between two looks at what the controller has begun."""


class Goal(NamedTuple):
    """A goal that the controller has begun."""

    unix: float
    """[s] since 1970."""
    key: str


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the demo."""

    ok: bool
    kills: int
    continued: int
    """Kills after which steps of the same command were taken."""
    twice: int
    """Steps that were taken more than once."""
    lost: int
    """Steps that were accepted and that the controller never began."""
    doubts: int
    """Steps of which nobody could say whether they had happened."""
    goals: int
    """Goals that the controller has begun for the command."""
    lever_angle_rad: float | None
    peak_force_n: float | None
    trouble: str
    """Why the command has not ended well; empty: it has."""
    wall_s: float


def verdict_of(
    kills: Sequence[float],
    goals: Sequence[Goal],
    events: Sequence[HistoryEvent],
    *,
    angle: float | None,
    force: float | None,
    trouble: str,
    wall: float,
) -> Verdict:
    """Compare what the controller did with what its callers asked. Pure.

    Args:
        kills: [s] since 1970, of the host.
        goals: that the controller has begun since the command was called.
        events: of the histories since then.
        angle: [rad] of the lever in the end.
        force: [N] the largest that the arm has felt.
        trouble: why the call has failed; empty: it has not.
        wall: [s] that all took.
    """
    calls = [event.key for event in events if (event.robot, event.kind) == (LEVER, "accepted")]
    own = [event for event in events if event.key.partition("/")[0] in calls]
    asked = Counter(event.key for event in own if (event.robot, event.kind) == (ARM, "accepted"))
    answered = {event.key for event in own if (event.robot, event.kind) == (MOVER, "answered")}
    last = [event.unix for event in own if (event.robot, event.kind) == (ARM, "accepted")]
    begun = Counter(goal.key for goal in goals)
    continued = sum(any(unix > kill for unix in last) for kill in kills) if len(calls) == 1 else 0
    repeated = sum(count - 1 for count in begun.values()) + sum(count - 1 for count in asked.values())
    twice = repeated + len(asked.keys() - answered) + max(0, len(begun) - len(asked))
    lost = max(0, len(asked) - len(begun))
    doubts = sum(event.error == CommandInDoubt.__name__ for event in own)
    closed = angle is not None and angle > CLOSED
    sound = not (twice or lost or doubts or trouble) and 0 < len(kills) == continued
    return Verdict(
        ok=closed and sound,
        kills=len(kills),
        continued=continued,
        twice=twice,
        lost=lost,
        doubts=doubts,
        goals=len(goals),
        lever_angle_rad=angle,
        peak_force_n=force,
        trouble=trouble,
        wall_s=round(wall, 2),
    )


def begun_in(file: Path) -> list[Goal]:
    """Return the goals that a controller has begun, in their order.

    Args:
        file: into which it writes them.
    """
    goals: list[Goal] = []
    with suppress(OSError):
        for line in file.read_text().splitlines():
            unix, word, key, *_ = line.split()
            if word == "begin":
                goals.append(Goal(float(unix), key))
    return goals


async def under_way(call: asyncio.Future[Any], file: Path, count: int) -> bool:
    """Wait until a controller has begun so many goals; return whether a call still runs then.

    Args:
        call: ends the wait, too.
        file: into which the controller writes them.
        count: of all goals in the file.
    """
    while not call.done() and len(begun_in(file)) < count:  # noqa: ASYNC110 # a file
        await asyncio.sleep(LOOKS)
    return not call.done()


async def events_since(realm_client: RealmClient, since: float) -> list[HistoryEvent]:
    """Return what the histories say of the lever's robots, when the end of the command is among it."""
    latest = time.monotonic() + SETTLES
    while True:
        events: list[HistoryEvent] = []
        for robot in (LEVER, MOVER, ARM):
            kept = await kept_events(realm_client, ReadEvents(robot=robot, since=since))
            events += [event for _, event in kept.events()]
        accepted = {event.key for event in events if (event.robot, event.kind) == (ARM, "accepted")}
        answered = {event.key for event in events if (event.robot, event.kind) == (MOVER, "answered")}
        over = any((event.robot, event.kind) == (LEVER, "ended") for event in events)
        if (over and accepted and accepted <= answered) or time.monotonic() > latest:
            return events
        await asyncio.sleep(0.1)


async def closed(
    realm_client: RealmClient,
    call: asyncio.Future[Any],
    file: Path,
    before: int,
    since: float,
    kills: Sequence[float],
) -> Verdict:
    """Wait until the lever's command is over, and say what came of it.

    Args:
        realm_client: joined.
        call: the command.
        file: what the controller begins.
        before: how many goals stood in it before the command.
        since: [Unix s] when it was called.
        kills: [Unix s] when something was killed.
    """
    trouble = ""
    try:
        await call
    except VrError as error:
        trouble = str(error)
    readings = (await realm_client.describe_view(VIEW)).readings
    return verdict_of(
        kills,
        begun_in(file)[before:],
        await events_since(realm_client, since),
        angle=readings.get("lever"),
        force=readings.get("peak_force"),
        trouble=trouble,
        wall=time.time() - since,
    )


class Counted(Course):
    """The cell, whose controllers write down in a folder of this demo what they begin."""

    file = CELL.file

    def __init__(self) -> None:
        """Make the folder."""
        self._folder = tempfile.TemporaryDirectory(prefix="robotree-demo-")
        self.goals = Path(self._folder.name)


class Crash(Counted):
    """The cell, its robots on top of the arm, and a host that is killed."""

    async def open(self, realm_client: RealmClient) -> str:
        """Put the lever's robots on the arm."""
        await build_lever(realm_client)
        return (
            f"{LEVER} closes its lever now, and {HOST}, where it lives, is killed meanwhile; ? shows all keys"
        )

    def summary(self, verdict: Verdict) -> str:
        """Say what came of it."""
        figures = f"{verdict.kills} kills, {verdict.continued} times continued, {verdict.twice} steps twice"
        if verdict.ok:
            return f"the lever is closed: {figures}, {verdict.doubts} in doubt"
        return f"the lever is not closed as it should be: {figures}; {verdict.trouble}"

    # -- the course -------------------------------------------------------------------------------

    async def course(self, realm_client: RealmClient, tell: Tell, *, alone: bool) -> Verdict:  # noqa: ARG002 # the same
        """Close the lever while its host is killed."""
        file = self.goals / CONTROLLER
        since, before = time.time(), len(begun_in(file))
        tell(f"{LEVER} closes its lever")
        call = asyncio.ensure_future(realm_client.call(LEVER, "close", {}, deadline=LONGEST))
        kills: list[float] = []
        for count in AT:
            pid = self._host(realm_client.realm) if await under_way(call, file, before + count) else None
            if pid is None:
                break
            kills.append(time.time())
            os.kill(pid, signal.SIGKILL)
            tell(f"{HOST} (process {pid}) is killed by kill -9; the demo starts it again", "warning")
        return await closed(realm_client, call, file, before, since, kills)

    def _host(self, realm: str) -> int | None:
        """Return the process of the host; None: it does not live at the moment."""
        found = programs(realm).items()
        return next((one.pid for who, one in found if (who.role, who.name) == ("host", HOST)), None)
