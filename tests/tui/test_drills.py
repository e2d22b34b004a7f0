"""A fault is said by whom it concerns, and ends with its time, with the drill, and with the trial."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from typing import TYPE_CHECKING

import psutil
import pytest

from robotree.tui.processes.thaw import freeze
from robotree.tui.screen.app import Supervisor
from robotree.tui.session.faults import drill_of, end_all
from robotree.tui.session.script import PlayedStep
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import State
from tests.screen import text_of
from tests.tui.conftest import play
from tests.waiting import until

if TYPE_CHECKING:
    from conftest import Realm


class Linked:
    """What is done to the link of the arm."""

    def __init__(self, realm: Realm) -> None:
        self.done: list[tuple[bool, float]] = []
        realm.arm.disturb = lambda *, cut, delay: self.done.append((cut, delay))  # type: ignore[attr-defined]


async def drilled(realm: Realm, text: str) -> list[PlayedStep]:
    with sitting_at("pts/3"):
        return (await play(realm, text))[1]


async def test_a_cut_begins_and_ends_with_the_line(realm: Realm) -> None:
    link = Linked(realm)
    told = await drilled(realm, "fault cut arm-1 --for 1min\nshow arm-1\nfault end\nshow arm-1\n")
    assert [each.held for each in told] == [True] * 4, [each.seen for each in told]
    assert "@pts/3" in told[1].seen
    assert "cut, by " in told[1].seen
    assert told[2].seen == "the drill is over: arm-1"
    assert "cut, by " not in told[3].seen
    assert link.done == [(True, 0.0), (False, 0.0)]


async def test_a_fault_ends_with_its_time(realm: Realm) -> None:
    link = Linked(realm)
    states: list[State] = []
    await realm.realm_client.watch_state("arm-1", lambda _, state: states.append(state))
    with sitting_at("pts/3"):
        await realm.realm_client.disturb("arm-1", "cut", seconds=0.05)
    await until(lambda: link.done == [(True, 0.0), (False, 0.0)], "it has ended by itself")
    await until(lambda: bool(states) and not states[-1].drill, "its state says nothing of it")


async def test_the_next_fault_takes_the_place_of_the_one_before(realm: Realm) -> None:
    link = Linked(realm)
    await drilled(realm, "fault cut arm-1\nfault delay arm-1 200ms\n")
    assert link.done == [(True, 0.0), (False, 0.0), (False, 0.2), (False, 0.0)]


async def test_a_fault_stands_on_the_screen(
    realm: Realm, tmp_path: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    Linked(realm)
    async with Supervisor(realm.realm_client, realm="").run_test(size=(80, 24)) as pilot:
        with sitting_at("pts/3"):
            await realm.realm_client.disturb("arm-1", "cut", seconds=60.0)
        await until(lambda: "DRILL: arm-1 cut, by " in text_of(pilot.app), "it stands on the screen")
        await realm.realm_client.disturb("arm-1", "")
        await until(lambda: "DRILL" not in text_of(pilot.app), "it is gone")


@pytest.mark.parametrize(
    ("seconds", "delay", "terminal", "reason"),
    [
        (0.0, 0.0, "pts/3", "it lasts more than 0"),
        (float("nan"), 0.0, "pts/3", "it lasts more than 0"),
        (7200.0, 0.0, "pts/3", "at most 3600 s"),
        (1.0, -1.0, "pts/3", "a delay is 0 to 60 s"),
        (1.0, float("inf"), "pts/3", "a delay is 0 to 60 s"),
        (1.0, 0.0, "mcp/claude", "may not command arm-1"),
        (1.0, 0.0, "", "only a person"),
    ],
)
async def test_what_cannot_be_a_drill_is_refused(
    realm: Realm, seconds: float, delay: float, terminal: str, reason: str
) -> None:
    link = Linked(realm)
    with sitting_at(terminal), pytest.raises(VrError, match=reason):
        await realm.realm_client.disturb("arm-1", "delay", seconds=seconds, delay=delay)
    assert link.done == []


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
async def test_a_frozen_process_wakes_with_the_drill_when_its_helper_is_gone(
    realm: Realm, number: signal.Signals
) -> None:
    frozen = psutil.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    try:
        pidfd = os.pidfd_open(frozen.pid)
        helper = await asyncio.to_thread(freeze, pidfd, 600.0)
        drill_of(realm.realm_client).frozen["arm-1"] = helper, pidfd
        await until(lambda: frozen.status() == psutil.STATUS_STOPPED, "it is frozen")
        helper.send_signal(number)
        await end_all(realm.realm_client)
        await until(lambda: frozen.status() != psutil.STATUS_STOPPED, "it goes on")
    finally:
        frozen.kill()
        frozen.wait()
