"""Code that ignores a cancel: it is interrupted, or abandoned, and then no other command moves the robot."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from robotree.vr import Robot, VrError, command
from robotree.vr.base.errors import CommandCancelled, DeadlineExceeded, StillRunning
from robotree.vr.base.requests import State, decode_event
from robotree.vr.running.frame import ATTEMPTS
from robotree.vr.running.runner import Interrupted, InterruptibleThread
from tests.command_line import ran
from tests.vr.core.conftest import REAL_GRACE

pytestmark = pytest.mark.real_threads


class IgnoresCancels(Robot):
    """A robot whose author has not thought of ending."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.done: list[str] = []
        self.release = threading.Event()

    @command
    def move(self) -> None:
        self.done.append("moved")

    @command(effect="read")
    def count_done(self) -> int:
        return len(self.done)

    @command
    def insist(self) -> None:
        """Ignore that it was cancelled."""
        while True:
            try:
                self.sleep(1.0)
            except VrError:
                self.done.append("ignored")

    @command
    def spin(self) -> None:
        """Compute for ever without asking."""
        n = 0
        while True:
            n += 1

    @command
    def defy(self) -> None:
        """Swallow every exception in an endless loop, as authors do."""
        while not self.release.is_set():
            with contextlib.suppress(BaseException):  # an interruption may strike between the two
                while not self.release.is_set():
                    with contextlib.suppress(BaseException):
                        self.release.wait(0.05)
                        self.progress(0.5)

    @command
    def doze(self) -> None:
        """Sleep in a call that cannot be interrupted."""
        time.sleep(0.6)
        self.done.append("woke")

    @command
    def long_sum(self) -> int:
        total = 0
        while not self.cancelled:
            total += 1
        self.check()
        return total

    @command
    def hang(self) -> None:
        """Block in a call that cannot be interrupted, until the test releases it."""
        self.release.wait()
        self.done.append("hung")
        self.sleep(1.0)
        self.done.append("went on")


async def test_a_command_that_asks_whether_it_is_cancelled_ends_by_itself(realm: Any) -> None:
    rover = await realm.start(IgnoresCancels("rover"))
    with pytest.raises(DeadlineExceeded):
        await realm.client(rover).call("long_sum", {}, deadline=0.5)


@pytest.mark.parametrize("stubborn", ["insist", "spin"])
async def test_code_that_does_not_listen_is_interrupted(realm: Any, stubborn: str) -> None:
    rover = await realm.start(IgnoresCancels("rover"))
    with pytest.raises(DeadlineExceeded):
        await realm.client(rover).call(stubborn, {}, deadline=0.2)
    await realm.client(rover).call("move", {})
    assert rover.description().abandoned == ()


async def test_code_that_cannot_be_interrupted_is_given_up_and_can_do_nothing_more(realm: Any) -> None:
    rover = await realm.start(IgnoresCancels("rover"))
    began = realm.runner.now()
    with pytest.raises(DeadlineExceeded):
        await realm.client(rover).call("hang", {}, deadline=0.2)
    assert realm.runner.now() - began > 0.2 + REAL_GRACE * ATTEMPTS, "it was interrupted first"
    await realm.until(lambda: len(rover.runtime.log.since(0)) == 2)  # the second one comes behind the reply
    ended, goes_on = rover.runtime.log.since(0)
    assert (ended.level, ended.text.partition(";")[0]) == (
        "failed",
        "rover.hang was not done within its deadline",
    )
    assert goes_on.text.startswith(f"hang has ended and its code still runs: {Path(__file__).name}, line ")
    rover.robot.release.set()
    await realm.until(lambda: not rover.description().abandoned)
    assert rover.robot.done == []


async def test_a_sleep_that_outlasts_its_cancel_is_told_and_the_robot_recovers_by_itself(realm: Any) -> None:
    rover = await realm.start(IgnoresCancels("rover"))
    client = realm.client(rover)
    dozing = asyncio.create_task(client.call("doze", {}, key="k"))
    await realm.until(lambda: rover.description().busy == "doze")
    await client.cancel("k", reason="enough")
    with pytest.raises(CommandCancelled, match="enough"):
        await dozing
    with pytest.raises(
        StillRunning, match=r"\(test_code_that_ignores_a_cancel.py, line \d+: time.sleep\(0.6\)\); wait until"
    ):
        await client.call("move", {})
    await realm.until(lambda: not rover.description().abandoned, within=5.0)
    await client.call("move", {})
    assert rover.robot.done == ["moved"], "what came after the sleep was interrupted"


async def test_beside_abandoned_code_nothing_moves_until_it_has_ended(
    realm: Any, caplog: pytest.LogCaptureFixture
) -> None:
    rover = await realm.start(IgnoresCancels("rover"), host="host-1")
    client = realm.client(rover)
    states: list[State] = []

    def hear(key: str, body: bytes) -> None:
        event = decode_event(body, key=key)
        assert isinstance(event, State)
        states.append(event)

    await realm.operator.subscribe("robot/rover/*/state", hear)
    calls = [
        asyncio.create_task(client.call(name, {}, key=key)) for name, key in (("defy", "k"), ("move", "l"))
    ]
    await realm.until(lambda: rover.description().waiting == 1)
    await client.cancel("k", reason="enough")
    with pytest.raises(CommandCancelled, match="enough"):
        await calls[0]
    sentence = r"its defy was ended but still runs \(test_code_that_ignores_a_cancel.py, line \d+"
    with pytest.raises(StillRunning, match=sentence):
        await calls[1]  # it waited behind
    with pytest.raises(StillRunning, match=sentence):
        await client.call("move", {})
    assert await client.call("count_done", {}) == 0, "what only reads is no danger"
    await realm.until(lambda: states[-1].abandoned == ("defy",), within=2.0)
    assert (await client.describe()).abandoned == ("defy",)
    assert "rover.defy is abandoned: it ignores every cancel and still runs" in caplog.text
    rover.robot.release.set()
    await realm.until(lambda: not rover.description().abandoned, within=5.0)
    assert "rover.defy has ended after all" in caplog.text
    await client.call("move", {})


# -- the thread is interrupted in the middle of anything, and leaves nothing behind ----------------


PROFILED = """
import sys, threading
from {module} import InterruptibleThread

ended = threading.Event()
InterruptibleThread(lambda: 1, lambda *_: ended.set(), name="quick").start()
ended.wait()
sys.setprofile(lambda *_: None)
(lambda: None)()
sys.setprofile(None)
print("alive")
"""


def run(work: object) -> tuple[InterruptibleThread, threading.Event, list[object]]:
    """Begin some work; what came of it is in the list once the event is set."""
    ended, outcome = threading.Event(), list[object]()

    def done(*told: object) -> None:
        outcome.extend(told)
        ended.set()

    thread = InterruptibleThread(work, done, name="author")  # type: ignore[arg-type]
    thread.start()
    return thread, ended, outcome


def test_a_loop_that_asks_nobody_is_interrupted() -> None:
    began = threading.Event()

    def work() -> None:
        for _ in itertools.count():
            began.set()

    thread, ended, outcome = run(work)
    began.wait()
    thread.interrupt()
    assert ended.wait(10)
    assert isinstance(outcome[1], Interrupted)


def test_an_interruption_at_the_very_end_is_heard_once_or_not_at_all() -> None:
    for _ in range(300):
        thread, ended, outcome = run(lambda: 7)
        thread.interrupt()
        assert ended.wait(10)
        assert outcome[0] == 7 or isinstance(outcome[1], Interrupted)


def test_what_has_ended_does_not_make_a_profiled_process_turn_on_the_spot() -> None:
    script = PROFILED.format(module=InterruptibleThread.__module__)
    done = ran([sys.executable, "-c", script], check=True, within=60)
    assert done.stdout == "alive\n"
