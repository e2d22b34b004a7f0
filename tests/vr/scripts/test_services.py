"""Services: pages that bring behaviours along, and take them away again; nobody else notices."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.base.errors import CommandFailed, DuplicateName, StillBonded
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient
from tests.vr.place import HostPlace
from tests.waiting import until

GREETER = Path(__file__).parents[3] / "examples/services/greeter.py"
COMPANION = """
from robotree.vr import VirtualRobot, command, state

class Companion(VirtualRobot):
    said: list[str] = state([])

    @command
    def say(self, text: str) -> None:
        self.said = [*self.said, text]
"""
BOSS = """
from robotree.vr import Child, VirtualRobot

class Boss(VirtualRobot):
    child = Child("Greeter")
"""

ORACLE = """
from robotree.vr import Service, Stream, command

class Oracle(Service):
    words = Stream(str)

    @command
    def ask(self, how: str) -> str:
        if how == "hang":
            while True:
                self.sleep(60.0)
        if how == "lie":
            self.words.send(5)
        if how == "flood":
            for number in range(500):
                self.words.send(str(number))
        return "an answer"
"""
NEEDY = """
script: needy
start: {itself: yes}
partners:
  oracle: {kind: Oracle, needs: [ask], return: 1 s}
hears: {question: {how: text}}
facts:
  got: {what: none}
rules:
  - rule: ask
    when:
      - question: {how: $how}
    then:
      - do: oracle.ask
        with: {how: $how}
  - rule: refused
    when:
      - failed: {partner: oracle, reason: $reason}
    then:
      - log: "it failed: $reason"
"""
LISTENER = """
from robotree.vr import VirtualRobot, Watch, command

class Listener(VirtualRobot):
    oracle = Watch("Oracle")

    @command
    def hear(self) -> list[str]:
        return [self.oracle.words.next("30 s")]
"""


def condition(place: HostPlace, name: str) -> str:
    return place.host.agents[name].robot.attributes["condition"]


@pytest.fixture
async def place(tmp_path: Path) -> AsyncIterator[HostPlace]:
    place = HostPlace(tmp_path)
    await place.start()
    await place.client.create(Bundle(COMPANION, "companion.py"), "companion")
    yield place
    await place.end()


def test_the_simplest_service_has_at_most_forty_lines() -> None:
    assert len(GREETER.read_text().splitlines()) <= 40


async def test_a_service_comes_and_goes_and_no_robot_notices(place: HostPlace) -> None:
    companion = place.host.agents["companion"]
    before, lines = companion.address, len(companion.runtime.log.since(0))
    await place.client.create(Bundle.read(GREETER), "greeter")
    assert set(place.host.agents) == {"companion", "greeter", "greeter-greet"}
    assert condition(place, "greeter-greet").startswith("inactive: needs robot")
    await place.robot("greeter").enslave("companion", companion.address)
    assert companion.runtime.lease is None, "it is only watched"

    await place.robot("greeter-greet").enslave("robot", companion.address)

    async def is_active() -> bool:
        try:
            await place.robot("greeter-greet").call("visitor", {"who": "Anna"})
        except CommandFailed:  # its rules do not know of the partner yet
            return False
        return True

    await until(is_active, "its partner is there")
    await until(lambda: companion.description().kept["said"] == ["Welcome, Anna"], "it is greeted")

    await place.robot("greeter").delete()
    assert set(place.host.agents) == {"companion"}
    await until(lambda: companion.runtime.lease is None, "the companion is free again")
    assert companion.address == before
    assert not [line for line in companion.runtime.log.since(lines) if line.level in {"warning", "error"}]


async def test_a_robot_that_only_has_the_name_of_a_behaviour_is_nobodys(place: HostPlace) -> None:
    await place.client.create(Bundle(COMPANION, "companion.py"), "greeter-greet")
    with pytest.raises(DuplicateName):
        await place.client.create(Bundle.read(GREETER), "greeter")
    assert set(place.host.agents) == {"companion", "greeter-greet"}, "nothing is left of the service"
    await place.robot("greeter-greet").delete()

    await place.client.create(Bundle.read(GREETER), "greeter")
    await place.robot("greeter-greet").delete()
    await place.client.create(Bundle(COMPANION, "companion.py"), "greeter-greet")
    await place.robot("greeter").delete()
    assert set(place.host.agents) == {"companion", "greeter-greet"}


async def test_a_service_keeps_its_behaviours_over_a_restart_and_a_reload(place: HostPlace) -> None:
    await place.client.create(Bundle.read(GREETER), "greeter")
    await place.robot("greeter").call("count", {"text": "one two"})
    await place.end()
    await place.start()
    assert set(place.host.agents) == {"companion", "greeter", "greeter-greet"}
    assert await place.robot("greeter").call("count", {"text": "three"}) == 3
    source = GREETER.read_text()
    other = source.replace(
        'behaviours: ClassVar = {"greet": GREET}', 'behaviours: ClassVar = {"meet": GREET}'
    )
    await place.client.reload(Bundle(other, str(GREETER)), "greeter")
    assert set(place.host.agents) == {"companion", "greeter", "greeter-meet"}
    await place.robot("greeter").delete()
    assert set(place.host.agents) == {"companion"}


async def test_a_service_that_somebody_else_commands_is_not_deleted(place: HostPlace) -> None:
    await place.client.create(Bundle.read(GREETER), "greeter")
    await place.client.create(Bundle(BOSS, "boss.py"), "boss")
    await place.robot("boss").enslave("child", place.host.agents["greeter"].address)
    with pytest.raises(StillBonded):
        await place.robot("greeter").delete()
    assert "greeter-greet" in place.host.agents, "nothing is lost"


@pytest.mark.parametrize("given", ["5", "{1: 'text'}", "{'no name!': 'text'}"])
async def test_behaviours_that_cannot_be(place: HostPlace, given: str) -> None:
    page = f"from robotree.vr import Service\n\nclass Wrong(Service):\n    behaviours = {given}\n"
    with pytest.raises(Exception, match=r"Wrong.behaviours"):
        await place.client.create(Bundle(page, "wrong.py"), "wrong")


async def test_a_service_that_hangs_lies_floods_or_dies_costs_only_who_needs_it(place: HostPlace) -> None:
    """Its own host and the behaviour that needs it; another service beside it goes on after each."""
    transport = place.network.join("host-2")
    other = Host(transport, "host-2")
    await other.start()
    there = HostClient(place.network.join("somebody"), other.address)
    await there.create(Bundle(ORACLE, "oracle.py"), "oracle")
    oracle = other.agents["oracle"]
    await place.client.create(Bundle(NEEDY, "needy.yaml"), "needy")
    await place.client.create(Bundle(LISTENER, "listener.py"), "listener")
    await place.robot("needy").enslave("oracle", oracle.address)
    await place.robot("listener").enslave("oracle", oracle.address)
    companion = place.host.agents["companion"]
    await place.client.create(Bundle.read(GREETER), "greeter")
    await place.robot("greeter-greet").enslave("robot", companion.address)

    async def question(how: str) -> bool:
        try:
            await place.robot("needy").call("question", {"how": how})
        except CommandFailed:
            return False
        return True

    async def greeted(who: str) -> bool:
        try:
            await place.robot("greeter-greet").call("visitor", {"who": who})
        except CommandFailed:  # its rules do not know of the partner yet
            return False
        return True

    async def still_greets(who: str) -> None:
        await until(lambda: greeted(who), "its partner is there")
        await until(lambda: f"Welcome, {who}" in companion.description().kept["said"], f"{who} is greeted")

    hearing = asyncio.ensure_future(place.robot("listener").call("hear", {}))
    listens = "somebody listens"
    await until(lambda: next(iter(oracle.description().streams)).listeners == 1, listens)
    await until(lambda: question("lie"), "it is asked")
    await still_greets("liar")
    await until(lambda: question("flood"), "it is asked again")
    assert (await hearing)[0].isdigit(), "what was no word did not come"
    await still_greets("flooder")
    await until(lambda: question("hang"), "it is asked a last time")
    await still_greets("hanging")
    place.network.kill(transport)
    await until(lambda: condition(place, "needy").startswith("inactive: needs oracle"), "it is missed")
    await still_greets("dead")
    assert condition(place, "greeter-greet") == "active"
    await other.close()
