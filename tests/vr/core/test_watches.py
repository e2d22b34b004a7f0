"""Slots that only watch: streams and readings without a lease, beside whoever commands the robot."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import pytest

from robotree.vr import Child, SlotEmpty, Stream, Unit, VirtualRobot, Watch, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import SlotOccupied, WrongKind
from robotree.vr.base.places import place_key, site_key
from robotree.vr.core.machine import decode_state, encode_state
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.orders.ledger import Ledger, OrderMemory
from robotree.vr.running.feed import MOST_KEPT
from robotree.vr.running.process import Process
from tests.vr.core.conftest import Realm, refusal, runner_here
from tests.waiting import until


@dataclass(frozen=True)
class Force:
    """What a hand feels."""

    x: Annotated[float, Unit("N")]
    y: Annotated[float, Unit("N")]


class Reporter(VirtualRobot):
    """Says words, feels forces."""

    words = Stream(str, "what it says")
    force = Stream(Force, "of its hand", rate=10)

    def readings(self) -> dict[str, float]:
        return {"battery": 0.5}

    @command
    def say(self, *, texts: list[str], pause: float = 0.0) -> None:
        for text in texts:
            self.sleep(pause)
            self.words.send(text)

    @command
    def feel(self, times: int) -> None:
        for number in range(times):
            self.force.send(Force(float(number), 0.0))
            self.sleep(0.01)

    @command
    def is_wanted(self) -> bool:
        return self.words.wanted

    @command
    def lie(self) -> None:
        self.words.send(5)  # type: ignore[arg-type]


class Listener(VirtualRobot):
    """Watches."""

    robot = Watch("Reporter")
    other = Watch("Reporter", optional=True)

    @command
    def hear(self, count: int, pause: float = 0.0) -> list[str]:
        heard: list[str] = []
        for word in self.robot.words():
            heard.append(word)
            if len(heard) == count:
                return heard
            self.sleep(pause if len(heard) == 1 else 0.0)
        return heard

    @command
    def feel(self, seconds: float) -> list[float]:
        felt: list[float] = []
        try:
            while True:
                felt.append(self.robot.force.next(seconds).x)
        except TimeoutError:
            return felt

    @command
    def hear_slowly(self, pause: float, within: str) -> list[str]:
        heard: list[str] = []
        try:
            while True:
                heard.append(next(self.robot.words(within=within)))
                self.sleep(pause)
        except TimeoutError:
            return heard

    @command
    def battery(self) -> float:
        return self.robot.readings.battery

    @command
    def command_it(self) -> None:
        self.robot.say(texts=["no"])


class Boss(VirtualRobot):
    """Commands a reporter."""

    below = Child("Reporter")

    @command
    def order(self, texts: list[str]) -> None:
        self.below.say(texts=texts)


def _listeners(agent: RobotAgent, stream: str) -> int:
    return next(one.listeners for one in agent.description().streams if one.name == stream)


async def test_many_watch_a_robot_beside_its_commander(realm: Realm) -> None:
    boss = await realm.team(Boss("boss"), below=Reporter("reporter"))
    one, two = await realm.start(Listener("one")), await realm.start(Listener("two"))
    reporter = boss.below
    for agent in (one, two):
        await realm.client(agent).enslave("robot", reporter.address)
    slot = one.description().slot("robot")
    assert slot is not None
    assert (slot.watch, slot.child, slot.watched) == (True, None, reporter.address)
    assert reporter.runtime.lease is not None
    assert reporter.runtime.lease.parent == boss.address, "it is still commanded by its boss"
    said = [line.text for line in one.runtime.log.since(0)]
    assert not any("enslaved" in text for text in said), said

    hearing = [asyncio.ensure_future(realm.client(agent).call("hear", {"count": 3})) for agent in (one, two)]
    await until(lambda: _listeners(reporter, "words") == 2, "both listen")
    await realm.client(boss).call("order", {"texts": ["a", "b", "c"]})
    assert await asyncio.gather(*hearing) == [["a", "b", "c"], ["a", "b", "c"]]
    assert await realm.client(one).call("battery", {}) == 0.5


async def test_a_stream_is_wanted_only_while_somebody_listens_and_kept_for_who_is_at_work(
    realm: Realm,
) -> None:
    reporter, listener = await realm.start(Reporter("reporter")), await realm.start(Listener("listener"))
    await realm.client(listener).enslave("robot", reporter.address)
    assert await realm.client(reporter).call("is_wanted", {}) is False
    hearing = asyncio.ensure_future(
        realm.client(listener).call("hear_slowly", {"pause": 0.2, "within": "300 ms"})
    )
    await until(lambda: _listeners(reporter, "words") == 1, "it listens")
    assert await realm.client(reporter).call("is_wanted", {}) is True
    await realm.client(reporter).call("say", {"texts": ["a", "b", "c"], "pause": 0.05})
    assert await hearing == ["a", "b", "c"]
    await until(lambda: _listeners(reporter, "words") == 0, "it listens no more")


async def test_a_stream_keeps_its_rate_and_its_type_and_counts_what_it_sends(realm: Realm) -> None:
    reporter, listener = await realm.start(Reporter("reporter")), await realm.start(Listener("listener"))
    await realm.client(listener).enslave("robot", reporter.address)
    feeling = asyncio.ensure_future(realm.client(listener).call("feel", {"seconds": 1.0}))
    await until(lambda: _listeners(reporter, "force") == 1, "it listens")
    await realm.client(reporter).call("feel", {"times": 200})  # 2 s, 100 in a second
    felt = await feeling
    assert 19 <= len(felt) <= 22
    assert felt == sorted(felt)
    force = next(one for one in reporter.description().streams if one.name == "force")
    assert force.left_out >= 170
    assert [part.unit for part in force.value.items] == ["N", "N"]

    hearing = asyncio.ensure_future(realm.client(listener).call("hear", {"count": 40}))
    await until(lambda: _listeners(reporter, "words") == 1, "it listens")
    saying = asyncio.ensure_future(
        realm.client(reporter).call("say", {"texts": ["x" * 1000] * 40, "pause": 0.1})
    )
    await asyncio.sleep(3.0)
    words = next(one for one in reporter.description().streams if one.name == "words")
    assert 9_000 < words.sent < 12_000, "ten of a kilobyte in a second"
    await saying
    await hearing


async def test_a_listener_that_reads_slowly_loses_the_oldest_and_holds_up_nobody(realm: Realm) -> None:
    reporter = await realm.start(Reporter("reporter"))
    quick, slow = await realm.start(Listener("quick")), await realm.start(Listener("slow"))
    for agent in (quick, slow):
        await realm.client(agent).enslave("robot", reporter.address)
    count = 3 * MOST_KEPT
    hearing = asyncio.ensure_future(realm.client(quick).call("hear", {"count": count}))
    sleepy = asyncio.ensure_future(realm.client(slow).call("hear", {"count": MOST_KEPT + 1, "pause": 10.0}))
    await until(lambda: _listeners(reporter, "words") == 2, "both listen")
    texts = [str(number) for number in range(count)]
    await realm.client(reporter).call("say", {"texts": texts, "pause": 0.01})
    assert await hearing == texts
    assert await sleepy == ["0", *texts[-MOST_KEPT:]]


async def test_it_goes_on_with_the_next_life_of_the_robot(realm: Realm) -> None:
    reporter, listener = await realm.start(Reporter("reporter")), await realm.start(Listener("listener"))
    await realm.client(listener).enslave("robot", reporter.address)
    hearing = asyncio.ensure_future(realm.client(listener).call("hear", {"count": 2}))
    await until(lambda: _listeners(reporter, "words") == 1, "it listens")
    await realm.client(reporter).call("say", {"texts": ["before"]})
    realm.kill(reporter)
    slot = listener.description().slot("robot")
    assert slot is not None
    assert slot.filled, "it stays filled while the robot is away"
    later = await realm.start(Reporter("reporter"), realm.network.join("reporter's next process"))
    await until(lambda: _listeners(later, "words") == 1, "it listens to the next life")
    await realm.client(later).call("say", {"texts": ["after"]})
    assert await hearing == ["before", "after"]
    slot = listener.description().slot("robot")
    assert slot is not None
    assert slot.watched == later.address


async def test_it_follows_the_robot_to_another_site_and_no_other_one_of_its_name(realm: Realm) -> None:
    gateway = realm.network.join("gateway")
    await gateway.announce(site_key("hall"))

    async def at_hall(process_name: str, orders: OrderMemory) -> RobotAgent:
        transport = realm.network.join(process_name)
        realm.processes.append(process := Process(runner_here()))
        agent = RobotAgent(
            Reporter("reporter"),
            transport,
            registrar=Registrar(transport),
            unix=lambda: realm.unix,
            process=process,
            orders=orders,
        )
        await gateway.announce(place_key("hall", agent.address.key))  # before the agent, as gateways do it
        await agent.start()
        realm.agents.append(agent)
        return agent

    its = OrderMemory(Ledger(None), "the-reporter")
    reporter = await realm.start(Reporter("reporter"), orders=its)
    listener = await realm.start(Listener("listener"))
    await realm.client(listener).enslave("robot", reporter.address)
    realm.kill(reporter)
    foreign = await at_hall("a process of hall", OrderMemory(Ledger(None), "another"))
    await asyncio.sleep(10)

    def watched() -> object:
        slot = listener.description().slot("robot")
        return slot and slot.watched

    assert watched() == reporter.address, "the robot of its name at hall is another one"
    realm.kill(foreign)
    moved = await at_hall("another process of hall", its)
    await until(lambda: watched() == moved.address, "it is followed to hall")


async def test_what_is_refused(realm: Realm) -> None:
    reporter, other = await realm.start(Reporter("reporter")), await realm.start(Reporter("other"))
    listener = await realm.start(Listener("listener"))
    client = realm.client(listener)
    assert isinstance(await refusal(client.call("hear", {"count": 1})), SlotEmpty)
    wrong = await refusal(client.enslave("robot", listener.address))
    assert isinstance(wrong, WrongKind)
    await client.enslave("robot", reporter.address)
    await client.enslave("robot", reporter.address)  # twice is once
    assert isinstance(await refusal(client.enslave("robot", other.address)), SlotOccupied)
    told = await refusal(client.call("command_it", {}))
    assert "listener.robot only watches: `say` is a stream" in str(told)
    await realm.client(reporter).call("lie", {})  # nobody listens: nothing is looked at
    hearing = asyncio.ensure_future(client.call("hear", {"count": 1}))
    await until(lambda: _listeners(reporter, "words") == 1, "it listens")
    failed = await refusal(realm.client(reporter).call("lie", {}))
    assert "words" in str(failed)
    await client.free("robot")
    assert isinstance(await refusal(hearing), SlotEmpty)
    assert isinstance(await refusal(client.free("robot")), SlotEmpty)


async def test_the_state_keeps_who_is_watched(realm: Realm) -> None:
    reporter, listener = await realm.start(Reporter("reporter")), await realm.start(Listener("listener"))
    await realm.client(listener).enslave("robot", reporter.address)
    state = decode_state(listener.runtime.look(encode_state))
    assert state.slots.watched() == {"robot": reporter.address}


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Stream(str, rate=-1), "the rate is from 0"),
        (lambda: Stream(str, 5), "say what is sent as a text"),  # type: ignore[arg-type]
        (lambda: Watch("no kind"), "is no kind"),
    ],
)
def test_mistakes_in_a_page(make: Callable[[], object], said: str) -> None:
    with pytest.raises(TypeError, match=said):
        make()
