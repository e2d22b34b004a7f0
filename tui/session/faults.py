"""Faults as verbs, for drills: what an accident would do, on purpose and for a while.

    fault cut arm-1 --for 3s             nothing crosses the link between the robot's proxy and its controller
    fault delay arm-1 200ms              everything takes this long there, each way
    fault freeze host-1 --for 2s         the process of a robot, host or lookup stops working (SIGSTOP)
    fault kill host-1                    its process is killed (SIGKILL); only what keeps it starts it again
    fault end                            all of them end that this session has begun

A fault lasts for its time, or until `fault end`, and never longer than the session, prompt or command that
has begun it: also when that is killed. It can be done to robots whom the person may command, and to
processes of the person on this machine. Each robot that suffers says so on all screens meanwhile.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import signal
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from weakref import WeakKeyDictionary

from robotree.tui.errors import NotForDrills
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.line.shell import once
from robotree.tui.line.verbs import Outcome, Teller
from robotree.tui.processes.thaw import freeze

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.supervision.realm_client import RealmClient

LASTS = 600.0
"""[s] that a fault lasts at most when the line does not say."""
HELPER_ENDS = 2.0
"""[s] that the helper that has frozen a process has to wake it; then we do."""

_ROBOT, _PROCESS = re.compile(r"robot/.*"), re.compile(r"process (\d+)")


class Drill:
    """The faults that one program has begun in one realm."""

    def __init__(self) -> None:
        """Begin without any."""
        self.disturbed = set[str]()
        """Robots that say what they suffer."""
        self.frozen = dict[str, tuple[subprocess.Popen[bytes], int]]()
        """Who keeps whom frozen, and the pidfd of whom, by the name in the line."""


_drills: WeakKeyDictionary[RealmClient, Drill] = WeakKeyDictionary()


def drill_of(realm_client: RealmClient) -> Drill:
    """Return the faults that were begun over a realm client."""
    return _drills.setdefault(realm_client, Drill())


async def fault_on_link(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Have nothing cross the link of a robot, or everything take longer: `fault cut`, `fault delay`."""
    name, seconds = line.text("ROBOT"), _seconds(line)
    fault: Literal["cut", "delay"] = "delay" if line.verb == "fault delay" else "cut"
    delay = values.duration(line.text("TIME")) if fault == "delay" else 0.0
    words = await realm_client.disturb(name, fault, seconds=seconds, delay=delay)
    drill_of(realm_client).disturbed.add(name)
    return Outcome({"drill": name, "fault": fault, "seconds": seconds}, f"drill: {name}: {words}")


async def fault_freeze(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Stop the process of an agent, and continue it in the end."""
    name, seconds, drill = line.text("NAME"), _seconds(line), drill_of(realm_client)
    number, robots = _process_of(realm_client, name)
    pidfd = os.pidfd_open(number)
    try:
        await _announce(realm_client, robots, "freeze", seconds)
        _wake(drill, (name,))
        drill.frozen[name] = await asyncio.to_thread(freeze, pidfd, seconds), pidfd
    except BaseException:
        os.close(pidfd)
        raise
    text = f"drill: process {number} of {name} is frozen for {seconds:g} s at most"
    return Outcome({"drill": name, "fault": "freeze", "process": number, "robots": robots}, text)


async def fault_kill(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Kill the process of an agent."""
    name = line.text("NAME")
    number, robots = _process_of(realm_client, name)
    pidfd = os.pidfd_open(number)
    try:
        await _announce(realm_client, robots, "kill", LASTS)
        signal.pidfd_send_signal(pidfd, signal.SIGKILL)
    finally:
        os.close(pidfd)
    again = "only what keeps it (the demo, systemd) starts it again"
    text = f"drill: process {number} of {name} was killed; {again}"
    return Outcome({"drill": name, "fault": "kill", "process": number, "robots": robots}, text)


async def fault_end(realm_client: RealmClient, _line: Line, _teller: Teller) -> Outcome:
    """End all faults that were begun from here."""
    ended = await end_all(realm_client)
    text = f"the drill is over: {', '.join(ended)}" if ended else "no fault was begun from here"
    return Outcome({"ended": ended}, text)


async def end_all(realm_client: RealmClient) -> list[str]:
    """End all faults that were begun over a realm client; returns whom they concerned."""
    from robotree.vr.base.errors import VrError

    if (drill := _drills.pop(realm_client, None)) is None:
        return []
    ended = sorted({*drill.frozen, *drill.disturbed})
    _wake(drill, tuple(drill.frozen))
    for name in drill.disturbed:
        with contextlib.suppress(VrError):  # it is gone, or wakes only now: it ends by itself
            await realm_client.disturb(name, "")
    return ended


async def _announce(
    realm_client: RealmClient, robots: Iterable[str], fault: Literal["freeze", "kill"], seconds: float
) -> None:
    """Have robots say what happens to their process.

    Raises:
        VrError: one of them does not allow it.
    """
    from robotree.vr.base.errors import NoAnswer, Unreachable

    for name in robots:
        with contextlib.suppress(NoAnswer, Unreachable):  # it hangs: it cannot say so
            await realm_client.disturb(name, fault, seconds=seconds)
            drill_of(realm_client).disturbed.add(name)


def _process_of(realm_client: RealmClient, name: str) -> tuple[int, list[str]]:
    """Return the process of an agent, and the robots that it holds.

    Raises:
        NotForDrills: there is none, it is ours, or another person's.
        NoSuchRobot: nobody has the name.
    """
    from robotree.vr.base.address import Address
    from robotree.vr.base.errors import NoSuchRobot

    held = [(address, one) for one in realm_client.held() if (address := Address.parse(one.key)) is not None]
    meant = [one for address, one in held if address.name == name]
    if not meant:
        raise NoSuchRobot(name=name)
    found = _PROCESS.match(meant[0].where)
    if found is None:
        raise NotForDrills(name, f"it is in {meant[0].where}, and a drill concerns this machine alone")
    number = int(found[1])
    try:
        owner = Path(f"/proc/{number}").stat().st_uid
    except OSError:
        raise NotForDrills(name, "its process has ended") from None
    if number == os.getpid():
        raise NotForDrills(name, "it lives in this program itself")
    if owner != os.geteuid():
        raise NotForDrills(name, f"process {number} is another person's")
    mates = [address.name for address, one in held if one.where == meant[0].where and address.role == "robot"]
    return number, sorted(set(mates))


def _wake(drill: Drill, names: Iterable[str]) -> None:
    for name in names:
        if (freezer := drill.frozen.pop(name, None)) is None:
            continue
        helper, pidfd = freezer
        for pipe in (helper.stdin, helper.stdout):
            if pipe is not None:
                pipe.close()
        try:
            helper.wait(HELPER_ENDS)
        except subprocess.TimeoutExpired:  # it was stopped itself
            helper.kill()
            helper.wait()
        with contextlib.suppress(ProcessLookupError):  # the helper does it, too, unless it was killed
            signal.pidfd_send_signal(pidfd, signal.SIGCONT)
        os.close(pidfd)


def _seconds(line: Line) -> float:
    return values.duration(line.text("--for")) if line.text("--for") else LASTS


async def begin(line: Line, realm: str) -> int:
    """Begin a fault, and keep it up until its time is over or Ctrl-C."""
    return await once(line, realm, hold)


async def hold(realm_client: RealmClient, line: Line) -> None:
    """Keep a fault of the command line up: for its time, or until Ctrl-C."""
    try:
        if line.verb not in {"fault kill", "fault end"}:
            await asyncio.sleep(_seconds(line))
    finally:
        await end_all(realm_client)
