"""Hooks that the author of a virtual robot writes: one after the other, and their results are reported."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable
from typing import Any

import pytest

from robotree.tui.seen.wording import portrait
from robotree.vr import VirtualRobot
from robotree.vr.base.errors import NotConfirmed
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.core.gate import Gate


class Valve(VirtualRobot):
    """A valve that opens when the test lets it."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.trace: list[str] = []
        self.may_open = Gate()
        self.may_open.set()
        self.fails = ""

    def safe_stop(self, reason: str) -> None:  # noqa: ARG002 # it closes for any
        if self.fails == "safe_stop":
            raise ValueError("it did not close")
        self.trace.append("closed")

    def resume(self) -> None:
        self.trace.append("opening")
        self.may_open.wait()
        if self.fails == "resume":
            raise ValueError("it did not open")
        self.trace.append("opened")


async def test_a_release_whose_hook_is_late_is_no_success_and_is_taken_back(
    realm: Any, realm_client: RealmClient
) -> None:
    valve = await realm.start(Valve("valve"))
    await realm_client.stop(None)
    valve.robot.may_open.clear()
    with pytest.raises(NotConfirmed, match=r"NOT by valve \(its resume has not ended\); look at"):
        await realm_client.resume(None)
    assert valve.description().stopped
    valve.robot.may_open.set()
    await realm.until(lambda: len(valve.robot.trace) == 4)
    assert valve.robot.trace[1:] == ["opening", "opened", "closed"]
    assert await realm_client.resume(None) == ["valve"]
    assert valve.robot.trace[-1] == "opened"


async def test_hooks_come_one_after_the_other_and_a_release_that_waits_does_not_begin_after_a_later_stop(
    realm: Any, realm_client: RealmClient
) -> None:
    valve = await realm.start(Valve("valve"))
    await realm_client.stop(None)
    valve.robot.may_open.clear()
    first = asyncio.create_task(realm_client.resume(None))
    await realm.until(lambda: "opening" in valve.robot.trace)
    second = asyncio.create_task(realm_client.resume(None))
    await asyncio.sleep(0.2)
    stopping = asyncio.create_task(realm_client.stop(None))
    await asyncio.sleep(0.2)
    assert not stopping.done(), "it has not closed yet"
    valve.robot.may_open.set()
    assert await stopping == ["valve"]
    for resuming in (first, second):
        with pytest.raises(NotConfirmed, match="it was stopped again"):
            await resuming
    assert valve.robot.trace == ["closed", "opening", "opened", "closed"]


async def test_a_hook_that_raises_has_confirmed_nothing(
    realm: Any, realm_client: RealmClient, caplog: pytest.LogCaptureFixture
) -> None:
    valve = await realm.start(Valve("valve"))
    valve.robot.fails = "safe_stop"
    with pytest.raises(
        NotConfirmed, match=r"NOT by valve \(its safe_stop failed\); press the emergency stop"
    ):
        await realm_client.stop(None)
    assert "valve.safe_stop failed" in caplog.text
    assert "it did not close" in caplog.text
    valve.robot.fails = "resume"
    with pytest.raises(NotConfirmed, match=r"NOT by valve \(its resume failed\)"):
        await realm_client.resume(None)
    assert valve.description().stopped
    await realm.until(lambda: valve.robot.trace[-1] == "closed")


async def test_what_a_hook_returns_to_wait_for_is_no_confirmation(
    realm: Any, realm_client: RealmClient
) -> None:
    class Returns(VirtualRobot):
        def safe_stop(self, reason: str) -> Awaitable[None] | None:  # noqa: ARG002 # it only returns
            return asyncio.sleep(0)

    await realm.start(Returns("returns"))
    with pytest.raises(NotConfirmed, match=r"NOT by returns \(its safe_stop failed\)"):
        await realm_client.stop(None)


class Boiler(VirtualRobot):
    """A boiler whose page has mistakes that only show at work."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.broken = True

    def readings(self) -> dict[str, float]:
        return {"heat": 1 / (not self.broken), "name": "boiler"}  # type: ignore[dict-item] # a mistake

    def safe_stop(self, reason: str) -> None:
        raise ValueError(f"the valve sticks at {reason}")


async def test_a_hook_that_fails_is_in_the_log_and_in_the_description_with_page_and_line(
    realm: Any, realm_client: RealmClient
) -> None:
    boiler = await realm.start(Boiler("boiler"))
    line = r"\(test_hooks\.py, line \d+\)"
    await realm.until(lambda: boiler.description().faults)
    (fault,) = boiler.description().faults
    assert re.fullmatch(rf"readings failed: ZeroDivisionError: division by zero {line}", fault)
    boiler.robot.broken = False
    await realm.until(lambda: "left out" in str(boiler.description().faults))
    (fault,) = boiler.description().faults
    assert re.fullmatch(
        rf"readings gives what is no number, which is left out: 'name' is 'boiler' {line}", fault
    )
    assert boiler.description().readings == {"heat": 1.0}
    with pytest.raises(NotConfirmed):
        await realm_client.stop(None)
    stop_fault = boiler.description().faults[-1]
    assert re.fullmatch(rf"safe_stop failed: ValueError: the valve sticks at .* {line}", stop_fault)
    logged = [each.text for each in boiler.runtime.log.since(0) if each.level == "error"]
    assert len(logged) == 3, "each fault is said once, however often readings are asked for"
    assert logged[-1] == stop_fault
    assert f"hook     {stop_fault}" in portrait(boiler.description())


async def test_a_hook_that_works_again_is_no_fault_any_more(realm: Any) -> None:
    class Mended(VirtualRobot):
        broken = True

        def readings(self) -> dict[str, float]:
            return {"heat": 1 / (not self.broken)}

    mended = await realm.start(Mended("mended"))
    await realm.until(lambda: mended.description().faults)
    mended.robot.broken = False
    await realm.until(lambda: not mended.description().faults)
    assert mended.description().readings == {"heat": 1.0}


@pytest.mark.parametrize(
    ("hook", "function", "sentence"),
    [
        ("safe_stop", lambda self: None, r"write def safe_stop\(self, reason\)"),  # noqa: ARG005 # the mistake
        ("resume", lambda self, reason: None, r"write def resume\(self\)"),  # noqa: ARG005 # the mistake
        ("readings", {"x": 1.0}, r"write it as a method: def readings\(\)"),
        ("readings", staticmethod(dict), r"write it as a method: def readings\(\)"),
    ],
)
def test_a_hook_that_nobody_could_call_is_refused_when_the_class_is_made(
    hook: str, function: Any, sentence: str
) -> None:
    with pytest.raises(TypeError, match=rf"Wrong\.{hook} .*{sentence}"):
        type("Wrong", (VirtualRobot,), {hook: function})
