"""The output of a robot's code is in its own log, and in no other robot's."""

from __future__ import annotations

import asyncio
import logging
import re
import sys
import threading
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from math import radians

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.base.description import FieldSpec
from robotree.vr.base.errors import BundleError, CommandCancelled, CommandFailed
from robotree.vr.base.requests import LoggedLine, LogLines, Returned, decode_event
from robotree.vr.bundle import Bundle
from robotree.vr.core.events import Ended
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.running.heard import listening
from robotree.vr.running.log import BURST, KEPT, Log
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until

PAGE = """
import contextvars, logging, sys, threading, warnings
from robotree.vr import VirtualRobot, command

print("loading")

class Talker(VirtualRobot):
    def __init__(self, name):
        super().__init__(name)
        print("made", name)

    @command
    def talk(self) -> None:
        print("hello", "world")
        print("no end", end="")
        sys.stderr.write("to the other stream\\n")
        logging.getLogger("mine").info("it %s", "logs")
        logging.error("badly")
        warnings.warn("old", UserWarning)

    @command
    def talk_in_a_thread(self) -> None:
        here = contextvars.copy_context()
        thread = threading.Thread(target=lambda: here.run(print, "from a thread"))
        thread.start()
        thread.join()

    @command
    def flood(self) -> None:
        for number in range(2000):
            print(number)

    @command
    def fail(self) -> None:
        raise ValueError("broken")

    @command
    def wait(self) -> None:
        print("waits")
        self.sleep(60)

    @command
    def swallow(self) -> None:
        print("swallows")
        try:
            self.sleep(60)
        except Exception as error:
            raise ValueError("my own") from error

    @command(effect="read")
    def look(self) -> int:
        return 1

    @command
    def debug(self) -> None:
        breakpoint()

    def safe_stop(self, reason):
        print("stops:", reason)
"""


class Stage:
    """A host with two robots of the same page."""

    def __init__(self) -> None:
        network = MemoryNetwork()
        self.operator = network.join("operator")
        self.host = Host(network.join("host-1"), "host-1")
        self.robots: dict[str, RobotClient] = {}

    async def begin(self) -> None:
        await self.host.start()
        client = HostClient(self.operator, self.host.address)
        for name in ("one", "two"):
            made = await client.create(Bundle(PAGE, "talker.py"), name)
            self.robots[name] = RobotClient(self.operator, made.address)

    async def lines(self, name: str) -> list[tuple[str, str]]:
        """Return what a robot has said after it was made."""
        said = await self.robots[name].read_log(2)
        return [(one.level, re.sub(r"(: | \()ran \d\.\d s\)?$", "", one.text)) for one in said]


@asynccontextmanager
async def on_stage() -> AsyncGenerator[Stage]:
    """Listen in the test itself: the streams of its fixtures are others."""
    with listening():
        stage = Stage()
        await stage.begin()
        yield stage
        await stage.host.close()


@pytest.mark.filterwarnings("default")
async def test_print_logging_and_warnings_are_in_the_robots_own_log() -> None:
    async with on_stage() as stage:
        await stage.robots["one"].call("talk", {})
        assert await stage.lines("one") == [
            ("info", "hello world"),
            ("warning", "to the other stream"),
            ("info", "it logs"),
            ("error", "badly"),
            ("warning", "UserWarning: old (talker.py, line 19)"),
            ("info", "no end"),
            ("done", "talk is done"),
        ]
        assert await stage.lines("two") == []


async def test_what_a_page_says_while_it_is_loaded_is_heard_too() -> None:
    async with on_stage() as stage:
        said = await stage.robots["two"].read_log()
        assert [one.text for one in said] == ["loading", "made two"]


async def test_a_breakpoint_in_a_host_fails_with_its_line_and_waits_for_nobody() -> None:
    async with on_stage() as stage:
        sentence = r"a host has no keyboard for breakpoint\(\).*\(talker\.py, line 56\)"
        with pytest.raises(CommandFailed, match=sentence):
            await stage.robots["one"].call("debug", {})
    assert sys.breakpointhook is sys.__breakpointhook__


async def test_a_page_that_asks_for_input_fails_at_once_and_reads_nothing_of_the_hosts() -> None:
    asking = "from robotree.vr import VirtualRobot\n\nNAME = input('?')\n\n\nclass Asking(VirtualRobot): ..."
    async with on_stage() as stage:
        client = HostClient(stage.operator, stage.host.address)
        with pytest.raises(BundleError, match="line 3: OSError: a page cannot read from the keyboard"):
            await client.create(Bundle(asking, "asking.py"), "asking")


async def test_a_thread_that_the_command_was_handed_on_to_speaks_for_it() -> None:
    async with on_stage() as stage:
        await stage.robots["one"].call("talk_in_a_thread", {})
        assert ("info", "from a thread") in await stage.lines("one")


async def test_success_failure_and_cancel_differ_whatever_the_code_makes_of_a_cancel() -> None:
    async with on_stage() as stage:
        robot = stage.robots["one"]
        with pytest.raises(CommandFailed):
            await robot.call("fail", {})
        for command in ("wait", "swallow"):
            waiting = asyncio.ensure_future(robot.call(command, {}))
            log = stage.host.agents["one"].runtime.log
            await until(lambda log=log, said=f"{command}s": log.since(0)[-1].text == said, "it waits")  # type: ignore[misc]
            await robot.cancel(reason="enough")
            with pytest.raises(CommandCancelled):
                await waiting
        await robot.call("look", {})
        lines = await stage.lines("one")
        assert [level for level, _ in lines] == ["failed", "info", "cancelled", "info", "cancelled"]
        assert "ValueError: broken" in lines[0][1]
        assert lines[-1][1] == "one.swallow was cancelled: enough"


async def test_hooks_speak_for_their_robot() -> None:
    async with on_stage() as stage:
        await stage.robots["two"].safe_stop("a hand")
        assert ("info", "stops: a hand") in await stage.lines("two")


async def test_a_flood_is_bounded_and_owns_up() -> None:
    async with on_stage() as stage:
        await stage.robots["one"].call("flood", {})
        said = await stage.robots["one"].read_log()
        assert len(said) <= KEPT
        dropped = [one for one in said if "lines were dropped" in one.text]
        assert len(dropped) >= 1
        assert dropped[0].level == "warning"


@pytest.mark.filterwarnings("default")
async def test_who_follows_hears_each_line_once() -> None:
    async with on_stage() as stage:
        heard: list[LoggedLine] = []

        def hear(key: str, body: bytes) -> None:
            event = decode_event(body, key=key)
            assert isinstance(event, LogLines)
            heard.extend(event.lines)

        watching = await stage.operator.subscribe(f"{stage.robots['one'].address.key}/log", hear)
        await stage.robots["one"].call("talk", {})
        await until(lambda: any(one.text.startswith("talk is done") for one in heard), "all of it")
        await watching.close()
        numbers = [one.number for one in heard]
        assert numbers == sorted(set(numbers))
        assert "hello world" in [one.text for one in heard]


def test_a_log_takes_some_lines_at_once_and_then_a_few_a_second() -> None:
    now = 0.0
    log = Log(lambda: now, lambda: 1000.0 + now, threading.Lock())
    for number in range(BURST + 10):
        log.say("info", str(number))
    lines = log.since(0)
    assert [line.text for line in lines[-2:]] == [
        str(BURST - 1),
        "10 lines were dropped: it takes 50 a second",
    ]
    now = 1.0
    log.say("info", "again")
    assert log.since(lines[-1].number)[0].text == "again"


def test_a_line_shows_four_digits_of_an_argument_and_keeps_all_of_them() -> None:
    log = Log(lambda: 0.0, lambda: 1000.0, threading.Lock())
    sent = {"y": -3.355169440888428e-12, "z": 0.30000000000000004, "twist": -0.0}
    log.settle(Ended("k", "go_to", sent, Returned(key="k"), "", 1, "mover", False, 0.0, 0.0, 1.0))
    (line,) = log.since(0)
    assert line.text == "go_to by mover is done: ran 1.0 s  (y=0.0 z=0.3 twist=0.0)"
    assert line.arguments == "y=-3.355169440888428e-12 z=0.30000000000000004 twist=-0.0"


def test_a_line_shows_the_angles_of_a_command_in_degrees_and_keeps_them_as_they_came() -> None:
    turn = [FieldSpec(name="twist", type="float", unit="rad"), FieldSpec(name="at", type="str")]
    log = Log(lambda: 0.0, lambda: 1000.0, threading.Lock(), {"turn": turn}.__getitem__)
    sent = {"twist": radians(45), "at": "noon"}
    log.settle(Ended("k", "turn", sent, Returned(key="k"), "", 1, "mover", False, 0.0, 0.0, 1.0))
    (line,) = log.since(0)
    assert line.text == "turn by mover is done: ran 1.0 s  (twist=45deg at=noon)"
    assert line.arguments == f"twist={radians(45)} at=noon"


def test_what_nobody_says_goes_where_it_went(capsys: pytest.CaptureFixture[str]) -> None:
    streams = sys.stdout, sys.stderr
    level = logging.getLogger().level
    with listening():
        print("to the terminal")  # noqa: T201 # what is tested
    assert (sys.stdout, sys.stderr, logging.getLogger().level) == (*streams, level)
    assert capsys.readouterr().out == "to the terminal\n"
