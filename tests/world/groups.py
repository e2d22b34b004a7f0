"""Stories of groups and questions: one order for many, and a script that waits for what people say.

Four carts, each in a process of its own, a host that keeps a script on its disk, and two people. For 40 s
carts and the host are killed, paused, and cut off from people, and messages are lost. Meanwhile people
give loads and stops to groups, ring at the script's door, and answer its questions, both at once. Then all is
healed.

The laws of groups: an order has one answer of each member; each member carries it out once at most, nobody
else does, and an answer that says done is true; a member without a fault of its own carries the order out,
and is stopped by a stop, whatever happens to others; a stop names each member that is seen, also one that
does not answer. The laws of questions: each that was put has one end, an answer or its time limit, whatever
happens to the script; the answer that the script gets is that of the person whose answer was accepted, and
never one of a person whose answer was refused.
"""

from __future__ import annotations

import asyncio
import random
import re
import tempfile
from collections import Counter
from collections.abc import Callable
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from robotree.tui.errors import SupervisorError
from robotree.tui.line import groups
from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Silent, function_of
from robotree.tui.line.surface import Surface
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.agents.run import kept_by
from robotree.vr.author.command import command
from robotree.vr.author.robot import Robot
from robotree.vr.base.errors import CommandFailed, VrError
from robotree.vr.base.group import RobotGroup
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient
from robotree.vr.journal.journal import HostJournal
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.policy_file import PolicyFile
from robotree.vr.running.process import Process
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.disk import LogClocks, Medium, MemoryDisk
from robotree.vr.world.world import Main, SimulatedProcess, World
from tests.world.realm import be_lookup, be_operator
from tests.world.story import Laws

BUILT, CALM, LENGTH = 3.0, 40.0, 70.0
"""[s] from when on people act; from when on nothing goes wrong; of a story."""
SETTLED = 4.0
"""[s] after which what has happened to a process shows no more: longer than the lease of the network."""
LIMIT = 6.0
"""[s] for an answer to a question."""
RETURNS = 3.0
"""[s] that callers wait for the host."""
CARTS = ("cart-1", "cart-2", "cart-3", "cart-4")
FULL = CARTS[:3]
"""Those that fulfil the rule of the group `full`."""
PEOPLE = ("anna-1", "bela-1")
GROUPS = {"all": CARTS, "full": FULL}
TOO_HEAVY = {"cart-3"}
"""Refuse what is heavy."""
DOOR = f"""
script: door
start: {{itself: yes}}
hears: {{ring: {{who: text}}}}
facts:
  visit: {{who: none, said: none, ends: 0}}
rules:
  - rule: ask
    when: [ring: {{who: $w}}]
    then:
      - remember: {{visit: {{who: $w}}}}
      - ask: {{question: "May $w come in?", answers: [anna-1, bela-1]}}
        as: $w
      - wait: {{name: late, for: {LIMIT:g} s, conversation: $w}}
  - rule: answered
    when:
      - answered: {{answer: $a, conversation: $w}}
      - visit: {{who: $w, ends: $n}}
        as: v
    then:
      - update v: {{said: $a, ends: = $n + 1}}
      - cancel: $w
  - rule: late
    when:
      - timer: {{name: late, conversation: $w}}
      - visit: {{who: $w, ends: $n}}
        as: v
    then:
      - update v: {{said: nobody, ends: = $n + 1}}
      - cancel: $w
"""


VISIT = re.compile(r"\(visit \(who (\S+)\) \(said (\S+)\) \(ends (\S+)\)\)")


EVER = 1_000
"""More than answers to one question."""


class Cart(Robot):
    """A cart that tells the story what it does."""

    def __init__(self, name: str, story: GroupStory) -> None:
        super().__init__(name)
        self.story = story

    def readings(self) -> dict[str, float]:
        return {"battery": 80.0 if self.name in FULL else 20.0}

    def safe_stop(self, reason: str) -> None:
        del reason
        self.story.stops.append((self.story.now, self.name))

    @command
    def load(self, ticket: float, heavy: bool) -> None:  # noqa: FBT001 # an argument of a command
        """Take something on."""
        if heavy and self.name in TOO_HEAVY:
            raise ValueError("too heavy")
        self.story.begun[self.name, ticket] += 1
        self.sleep(0.3)
        self.story.done[self.name, ticket] += 1


class GroupStory(Laws):
    """One story, from a seed."""

    def __init__(self, world: World, folder: Path) -> None:
        super().__init__(world)
        self.chance = random.Random(f"{world.seed} groups")
        world.network.gate = PolicyFile(folder)
        self.begun: Counter[tuple[str, float]] = Counter()
        self.done: Counter[tuple[str, float]] = Counter()
        self.stops: list[tuple[float, str]] = []
        self.processes: dict[str, SimulatedProcess] = {}
        self.people: dict[str, RealmClient] = {}
        self.agents: dict[str, RobotAgent] = {}
        self.host: Any = None
        self.answers = self.reached = self.failures = self.counted = 0
        """Answers of members; stops of those that had to be; members that failed; answers that count."""
        self.rung: set[str] = set()
        self.asked_at: dict[str, float] = {}
        self.answered_at: dict[str, float] = {}
        self.downs: list[float] = []
        """[s] when the script's host was killed."""
        self.ends: Counter[str] = Counter()
        """How questions ended: who answered, or nobody."""
        self.crossed = 0
        """Questions during which the host was killed."""
        self.refused: Counter[tuple[str, str]] = Counter()
        """How often a question's answer by somebody was refused, far below 0 if one may have counted."""
        self.said: dict[str, str] = {}
        """By question, who was told that it counts what he has said."""
        self._shaken: dict[str, float] = {}
        """[s] when something happened to a process, or will have ended."""
        self._medium, self._tickets = Medium(), 0.0
        self._commands = 0
        """Orders for stops and resumptions that are under way."""

    @property
    def now(self) -> float:
        return self.world.runner.now()

    def tell(self) -> None:
        at, chance = self.world.runner.at, self.chance
        for name in ("lookup-1", "host-1", *CARTS, *PEOPLE):
            self.start(name)
        at(1.5, lambda: self.as_person(PEOPLE[0], self._build))
        for _ in range(12):
            at(chance.uniform(BUILT, CALM), self.fault)
        for _ in range(4):
            at(chance.uniform(BUILT, CALM), partial(self.fault, "host-1"))
        for _ in range(30):
            at(chance.uniform(BUILT, CALM), self.load)
        for number in range(6):
            at(BUILT + number * (CALM - BUILT) / 6 + chance.uniform(0.0, 3.0), self.stop)
        for number in range(20):
            when = chance.uniform(BUILT, CALM)
            at(when, partial(self.ring, f"guest-{number}"))
            for name in PEOPLE:
                if chance.random() < 0.7:
                    at(when + chance.choice([0.5, 0.5, LIMIT - 0.01, LIMIT, 8.0]), partial(self.answer, name))
        at(CALM + 1.0, self.resume)
        for wait in (14.0, 16.0):
            at(CALM + wait, self.load)
        at(CALM + 20.0, self.stop)
        at(LENGTH - 1.0, self.judge)
        self.world.run(LENGTH)
        self.broken += self.world.complaints

    # -- the processes ----------------------------------------------------------------------------

    def start(self, name: str) -> None:
        mains: dict[str, Main] = {"lookup": be_lookup, "host": self._host, "cart": self._cart}
        main = mains.get(name.partition("-")[0], self._person)
        self.processes[name] = self.world.start(name, main)
        self._shake(name, 0.0)

    async def _cart(self, process: SimulatedProcess) -> None:
        transport = process.transport
        home = Process(process.runner, core=self.world.core)
        agent = RobotAgent(Cart(process.name, self), transport, registrar=Registrar(transport), process=home)
        await agent.start()
        self.agents[process.name] = agent
        await asyncio.Event().wait()

    async def _person(self, process: SimulatedProcess) -> None:
        await be_operator(process, self.people, watches=False)

    async def _host(self, process: SimulatedProcess) -> None:
        disk = MemoryDisk(self._medium, moment=lambda _: None, chance=self.chance.random)
        process.on_exit.append(disk.end)
        journal = HostJournal(Path("/keep"), LogClocks(process.runner), boot="boot 0", disk=disk)
        home: Process[Any] = Process(process.runner, journal, self.world.core)
        transport: Any = kept_by(journal, home, process.transport, RETURNS)
        registrar = Registrar(transport)
        self.host = Host(
            transport, process.name, registrar=registrar, process=home, limit=inf, journal=journal
        )
        await self.host.start()
        await self.host.restore()
        await asyncio.Event().wait()

    def as_person(self, name: str, work: Callable[[RealmClient], Any], what: str = "") -> None:
        if self.processes[name].alive and name in self.people:
            client = self.people[name]
            self.processes[name].do(lambda: work(client), what)

    async def _build(self, client: RealmClient) -> None:
        client.groups.write(RobotGroup(name="all", names=CARTS))
        client.groups.write(RobotGroup(name="full", rule="battery > 50"))
        address = await client.directory.resolve("host-1", "host")
        await HostClient(client._transport, address).create(Bundle(DOOR, "door.yaml"), "door")

    # -- what goes wrong --------------------------------------------------------------------------

    def _shake(self, name: str, seconds: float) -> None:
        self._shaken[name] = max(self._shaken.get(name, 0.0), self.now + seconds)

    def _is_well(self, since: float, *names: str) -> bool:
        """Whether nothing has happened to processes since then, nor shortly before."""
        return all(self._shaken[name] + SETTLED < since for name in names)

    def fault(self, name: str = "") -> None:
        name = name or self.chance.choice([*CARTS, *PEOPLE])
        kind = self.chance.choice(
            ["kill", "kill", "kill", "pause", "pause", "cut", "cut", "loss"]
            if name not in PEOPLE
            else ["cut"]
        )
        seconds, process = self.chance.choice([0.3, 1.0, 3.0]), self.processes[name]
        at, network = self.world.runner.at, self.world.network
        self._shake(name, seconds)
        self.world.note(name, kind, seconds)
        if kind == "kill" and process.alive:
            self.downs += [self.now] if name == "host-1" else []
            process.kill()
            at(self.now + seconds, partial(self.start, name))
        elif kind == "pause":
            process.pause()
            at(self.now + seconds, process.resume)
        elif kind == "cut":
            other = self.processes[self.chance.choice(PEOPLE if name not in PEOPLE else CARTS)]
            self._shake(other.name, seconds)
            if process.alive and other.alive:
                network.cut(process.transport, other.transport)
                at(self.now + seconds, partial(network.heal, process.transport, other.transport))
        elif kind == "loss":
            for each in self.processes:
                self._shake(each, seconds)
            network.weather.loss = network.weather.duplication = 0.1
            at(self.now + seconds, self._clear_up)

    def _clear_up(self) -> None:
        self.world.network.weather.loss = self.world.network.weather.duplication = 0.0

    # -- groups -----------------------------------------------------------------------------------

    async def _for_group(self, client: RealmClient, group: str, *words: str) -> dict[str, bool] | None:
        """Carry a line out for a group; None: nobody had it."""
        line = Surface(Where.SCRIPT).parse(words)
        try:
            found = await groups.for_all(function_of(line.verb), client, line, Silent(), group)
        except (VrError, SupervisorError) as error:
            self.world.note("order", "refused", type(error).__name__)
            return None
        answers = {one["name"]: one["ok"] for one in found.data["members"]}
        if len(answers) != len(found.data["members"]):
            self.complain("a member has answered twice")
        if (found.doubt is None) != all(answers.values()):
            self.complain("that some have failed is not told")
        return answers

    def load(self) -> None:
        """Give a load to a group."""
        self._tickets += 1.0
        ticket, heavy, name = self._tickets, self.chance.random() < 0.3, self.chance.choice(PEOPLE)
        group = self.chance.choice(list(GROUPS))
        words = ("call", f"{group}.load", f"ticket={ticket}", f"heavy={heavy}", "--within", "5s")

        async def give(client: RealmClient) -> None:
            since, stopped = self.now, self._stopped()
            answers = await self._for_group(client, group, *words)
            stopped |= self._stopped() | {cart for when, cart in self.stops if when >= since}
            well = {one for one in GROUPS[group] if self._is_well(since, one, name)}
            if answers is None:
                if well:
                    self.complain(f"{sorted(well)} were well, and an order to {group} was refused")
                return
            if outside := answers.keys() - set(GROUPS[group]):
                self.complain(f"{sorted(outside)} had an order to {group}")
            if group == "all" and answers.keys() != set(CARTS):
                self.complain("not each member that is named has an answer")
            for cart, ok in answers.items():
                self.answers += 1
                self.failures += not ok
                if ok and not self.done[cart, ticket]:
                    self.complain(f"{cart} has done what it never did")
            able = {one for one in well - stopped if not (heavy and one in TOO_HEAVY)}
            if short := {one for one in able if not answers.get(one)}:
                self.complain(f"{sorted(short)} were well, and did not carry an order out")

        self.as_person(name, give, f"gives {ticket}")

    def _stopped(self) -> set[str]:
        """Return the carts that are stopped, or on which a stop may be."""
        return {
            name
            for name, agent in self.agents.items()
            if self._commands or agent.runtime.core.state.stop.in_force
        }

    def stop(self) -> None:
        """Stop a group, and let it go again."""
        name, group = self.chance.choice(PEOPLE), self.chance.choice(list(GROUPS))

        async def give(client: RealmClient) -> None:
            self._commands += 1
            try:
                await stop(client)
                await asyncio.sleep(1.0)
                await self._for_group(client, "all", "resume", "all")
            finally:
                self._commands -= 1

        async def stop(client: RealmClient) -> None:
            since, held, seen = self.now, self._held(), _seen_by(client)
            answers = await self._for_group(client, group, "stop", group)
            silent = seen & _seen_by(client) & set(GROUPS[group]) - (answers or {}).keys()
            if silent and answers is not None:
                self.complain(f"a stop of {group} says nothing of {sorted(silent)}")
            well = {one for one in GROUPS[group] if self._is_well(since, one, name)}
            now_stopped = held | {cart for when, cart in self.stops if when >= since}
            if missed := well - now_stopped:
                self.complain(f"{sorted(missed)} were well, and a stop did not reach them")
            self.reached += len(well)
            for cart, ok in (answers or {}).items():
                if ok and cart in CARTS and cart not in now_stopped:
                    self.complain(f"{cart} has said that it is stopped, and is not")

        self.as_person(name, give, f"stops {group}")

    def _held(self) -> set[str]:
        return {name for name, agent in self.agents.items() if agent.runtime.core.state.stop.in_force}

    def resume(self) -> None:
        """Let all go again, now that nothing goes wrong."""
        self.as_person(PEOPLE[0], lambda client: self._for_group(client, "all", "resume", "all"), "resumes")

    # -- questions --------------------------------------------------------------------------------

    def ring(self, who: str) -> None:
        name = self.chance.choice(PEOPLE)

        async def ring(client: RealmClient) -> None:
            await client.call("door", "ring", {"who": who}, deadline=10.0)
            self.rung.add(who)
            self.asked_at[who] = self.now

        self.as_person(name, ring, f"rings {who}")

    def answer(self, name: str) -> None:
        """A person answers what he sees to be asked, with his name."""

        async def answer(client: RealmClient) -> None:
            asked = (await client.describe("door")).attributes.get("question-id", "")
            if not asked:
                return
            given = {"answer": name, "question": asked}
            try:
                await client.call("door", "answer", given, deadline=10.0)
            except CommandFailed:
                self.refused[asked, name] += 1
                raise
            except VrError:
                self.refused[asked, name] = -EVER
                raise
            if asked in self.said:
                self.complain(f"two were told that their answers to {asked} count")
            self.said[asked] = name
            self.answered_at[asked] = self.now
            self.counted += 1

        self.as_person(name, answer, "answers")

    def _was_down(self, who: str) -> bool:
        """Whether the script's host was killed while a question waited for its answer."""
        asked = self.asked_at.get(who, inf)
        return any(
            asked < when < asked + LIMIT and self.answered_at.get(who, inf) > when for when in self.downs
        )

    # -- the judge --------------------------------------------------------------------------------

    def judge(self) -> None:
        for (cart, ticket), count in self.begun.items():
            if count > 1:
                self.complain(f"{cart} has carried {ticket} out {count} times")
        agent = self.host.agents["door"]
        script = agent.robot
        if agent.runtime.core.state.stop.generation:  # it did not answer, and may have been one of `full`
            self.world.note("judge", "the script was stopped")
            return
        found = (VISIT.search(fact) for fact in script._run.engine.facts())
        visits = {one[1]: (one[2], float(one[3])) for one in found if one}
        self.ends = Counter(said for said, _ in visits.values())
        self.crossed = sum(self._was_down(who) for who in visits)
        for who in self.rung - visits.keys():
            self.complain(f"{who} has rung, and is forgotten")
        for who, (said, ends) in visits.items():
            if ends != 1:
                self.complain(f"the question for {who} has {ends:g} ends")
            if self.said.get(who, said) != said:
                self.complain(f"the answer to {who} is {said}, and {self.said[who]} was told that his counts")
            if who not in self.said and self.refused[who, said] > 0:
                self.complain(f"the answer to {who} is {said}, who was refused")
        self.world.note("judge", "visits", sorted(visits.items()))


def _seen_by(client: RealmClient) -> set[str]:
    return {address.name for address in client.directory.present("robot")}


def play(seed: int) -> tuple[str, GroupStory]:
    """Play the story of a seed; returns the digest of its trace, and what it has seen."""
    with tempfile.TemporaryDirectory() as folder, World(seed) as world:
        story = GroupStory(world, Path(folder))
        story.tell()
        return world.digest, story
