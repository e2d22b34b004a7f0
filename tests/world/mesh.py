"""Stories of a small mesh: five processes on one simulated machine, over the real network.

A story lasts 11 s. Until 6 s the members ask each other, publish, announce and withdraw, on their event loops
and in threads, while processes are killed, frozen, left and started again, connections break or stall, and
the realm's folder, the disk or the descriptors are gone. Then all is healed, and after five more seconds
everybody must hear everybody again.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from types import ModuleType
from typing import Any

from robotree.vr.base.errors import VrError
from robotree.vr.base.transport import Incoming, Occupied, Respond
from robotree.vr.network import lean_stop, realms
from robotree.vr.network.door import MOST_OF_ONE
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.realms import SOCKET
from robotree.vr.world.virtual_runner import VirtualProcess
from robotree.vr.world.world import SimulatedProcess
from tests.world.kernel import MOST_DESCRIPTORS, STANDARD, SimulatedSocket, Trouble
from tests.world.machine import (
    REALM,
    ROOT,
    MachineProcess,
    MachineWorld,
    SimulatedSystem,
    network_is_whole,
    play_on_machine,
)
from tests.world.story import Eventful, Laws

LENGTH, CALM, PROBE = 11.0, 6.0, 10.0
"""[s] of a story; from when on nothing goes wrong any more; when each asks each."""
MEMBERS = 5
TIMEOUT = 1.0
"""[s] for a request."""
ENDS = 6.0
"""[s] after which each request has ended: its time, and that of a process that hangs."""
QUIET = 4.0
"""[s] without a fault after which two members see each other as they are."""
SILENT = 3.2
"""[s] after which a frozen member counts as silent: `mesh.HANGS`, two ticks, and how late threads wake."""
AT_CALLS, AT_STATEMENTS = (0.0, 0.01, 0.3), (0.0, 0.001)
"""[s] that a thread waits at most which has lost the processor at a call, or between any two statements."""
STOPPED = 1.0
"""[s] after which a stop has come that was sent at once."""
SEEN = 0.12
"""[s] after which one that was frozen and goes on is seen again: less than half a tick."""
FOLDER = ROOT / REALM


class Member:
    """One process of the story; started again it is another member of the same name."""

    def __init__(self, story: MeshStory, name: str, life: int) -> None:
        self.story, self.name = story, name
        self.key = f"robot/{name}/{life}"
        self.began = story.world.runner.now()
        self.stops = 0
        """Stops of command lines that have come."""
        self.orders = Counter[str]()
        """The number of the last request of each asker, in each of its ways."""
        self.samples = Counter[str]()
        """The number of the last sample of each publisher."""
        self.seen: dict[str, bool] = {}
        """What it was told of presence."""
        self.numbers = Counter[str]()
        self.chance = random.Random(f"{story.world.seed} {self.key}")
        self.leaves = asyncio.Event()
        self.left = False
        self.process: Any = None

    async def main(self, process: SimulatedProcess) -> None:
        assert isinstance(process, MachineProcess)
        transport = self.transport = process.transport
        if transport.realm != REALM:
            self.story.complain(f"{self.name} is in the realm {transport.realm}")
        missing = set(self.story.undisturbed_keys()) - set(transport.presence.keys("robot/*/*"))
        if missing and self.story.last_fault < self.began:
            self.story.complain(f"{self.name} has joined and does not know {sorted(missing)}")
        await transport.serve(self.key, self.take)
        await transport.subscribe("robot/*/*/state", self.hear)
        transport.presence.watch("**", self.see)
        await transport.announce(self.key)
        await self.leaves.wait()
        await transport.close()
        self.left = True

    @property
    def ready(self) -> bool:
        return self.process.alive and self.process.joined and not self.leaves.is_set()

    def take(self, incoming: Incoming) -> None:
        """A request comes: it is answered here, on the loop, or here while others read."""
        if b"SafeStop" in incoming.body:
            self.stops += 1
            return
        way, _, text = incoming.body.decode().partition(" ")
        number = int(text)
        if number <= self.orders[way]:
            self.story.complain(f"{self.name} gets request {number} of {way} after {self.orders[way]}")
        self.orders[way] = number
        if self.chance.random() < 0.3:
            incoming.answer_on_loop(self.answer)
        elif self.chance.random() < 0.3 or not self.transport.after_reading(partial(self.work, incoming)):
            incoming.end(incoming.body)

    def work(self, incoming: Incoming) -> bool:
        self.process.runner.waiter().wait(self.chance.choice([0.0, 0.01, 0.1]))
        incoming.end(incoming.body)
        return True

    async def answer(self, body: bytes, respond: Respond) -> None:
        respond(b"progress")
        await asyncio.sleep(self.chance.choice([0.0, 0.05, 0.2]))
        respond(body)

    def hear(self, key: str, body: bytes) -> None:
        if int(body) <= self.samples[key]:
            self.story.complain(f"{self.name} hears sample {body!r} of {key} after {self.samples[key]}")
        self.samples[key] = int(body)

    def see(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        if self.seen.get(key, False) == there:
            self.story.complain(f"{self.name} is told twice that {key} is {there}")
        self.seen[key] = there
        holder = self.story.members[key.split("/")[1]] if key.startswith("robot/") else None
        if holder is not None and not there and self.story.quiet(self) and self.story.quiet(holder):
            self.story.complain(f"{self.name} is told that {key} is gone, and nothing has happened to it")

    def next(self, way: str) -> int:
        self.numbers[way] += 1
        return self.numbers[way]


class MeshStory(Laws, Eventful):
    """What happens to one mesh, and the laws that it must keep."""

    world: MachineWorld

    def __init__(self, seed: int, world: MachineWorld, *, starve: Sequence[float]) -> None:
        super().__init__(world)
        self.chance = random.Random(f"{seed} mesh")
        self._starve = self.chance.choice(starve)
        self.members: dict[str, Member] = {}
        self.open: dict[str, float] = {}
        """Requests that have not ended, and when they must have [s]."""
        self.answered = self.asked = self.faults = self.probes = 0
        self._lives = 0
        self._over = False
        self._disturbed: dict[str, float] = {}
        """When something happened to a member last."""
        self._all_disturbed = -QUIET
        """When something happened that touches all of them."""
        self._all_slept = -QUIET
        """When all were frozen last, or went on."""
        self.last_fault = -QUIET
        """When something happened last, or was over."""
        self._wounds = []

    # -- what happens -----------------------------------------------------------------------------

    def tell(self) -> None:
        world, chance = self.world, self.chance
        at, preemption = world.runner.at, world.runner.preemption
        preemption.share = chance.choice([0.0, 0.01, 0.05, 0.2])
        preemption.starve = self._starve
        world.machine.trouble = Trouble(
            split=chance.choice([0.0, 0.1, 0.5]),
            small=chance.choice([0.0, 0.0, 0.3]),
            late_accept=chance.choice([0.0, 0.01, 0.3]),
            late_wake=chance.choice([0.0, 0.002, 0.05]),
            full_backlog=chance.choice([0.0, 0.0, 0.1]),
            slow_death=chance.choice([0.0, 0.001, 0.1]),
        )
        for number in range(1, MEMBERS + 1):
            at(chance.choice([0.0, 0.0, chance.random()]), partial(self.start, f"member-{number}"))
        for _ in range(60):
            at(chance.uniform(0.5, CALM), chance.choice(self._deeds()))
        for _ in range(chance.randrange(2, 9)):
            at(chance.uniform(0.8, CALM - 0.5), partial(self._fault, chance.choice(self._faults())))
        at(CALM, self._heal)
        at(PROBE, self._probe)
        world.run(LENGTH)
        self._check()

    def start(self, name: str) -> None:
        """Start a member, or start it again; if it ends unasked it is started again by the operator."""
        if name in self.members and self.members[name].process.alive:
            return
        self._lives += 1
        member = self.members[name] = Member(self, name, self._lives)
        self._disturb(member)
        member.process = self.world.start(name, member.main)
        member.process.on_exit.append(lambda: self._after(self.chance.uniform(0.1, 1.0), self.start, name))

    def _disturb(self, *members: Member) -> None:
        """Something happens to members; none: to all."""
        now = self.world.runner.now()
        self._disturbed.update(dict.fromkeys((member.name for member in members), now))
        if not members:
            self._all_disturbed = now

    def quiet(self, member: Member) -> bool:
        """Whether nothing has happened to a member for some time, and nobody loses the processor for long."""
        if self._starve > SEEN:
            return False
        since = max(self._all_disturbed, self._disturbed.get(member.name, -QUIET))
        return self.world.runner.now() - since >= QUIET

    def undisturbed_keys(self) -> list[str]:
        """Return the keys of the members that everybody who joins must know."""
        return [one.key for one in self._ready() if self.quiet(one)]

    def _ready(self) -> list[Member]:
        return [
            member for member in self.members.values() if member.ready and not member.process.runner.halted
        ]

    # -- what members do --------------------------------------------------------------------------

    def _deeds(self) -> list[Callable[[], None]]:
        return [
            *[self._ask] * 4,
            *[self._ask_in_a_thread] * 4,
            *[self._publish] * 3,
            self._announce,
            self._subscribe_in_a_thread,
            self._rival,
            self._stop_by_a_command_line,
            self._be_visited,
        ]

    def _pair(self) -> list[Member]:
        ready = self._ready()
        return self.chance.sample(ready, 2) if len(ready) > 1 else []

    def _ask(self) -> None:
        if pair := self._pair():
            one, other = pair
            self._on_loop(one, self._request(one, other, urgent=self.chance.random() < 0.5))

    async def _request(self, one: Member, other: Member, *, urgent: bool) -> None:
        way = f"{one.key}|{other.key}|loop{urgent}"
        body = f"{way} {one.next(way)}".encode()
        self._begin(body, one)
        replies = list[bytes]()
        with contextlib.suppress(VrError):
            replies.extend(
                [
                    reply
                    async for reply in one.transport.request(other.key, body, timeout=TIMEOUT, urgent=urgent)
                ]
            )
        self._end(body, [*replies, None])

    def _ask_in_a_thread(self) -> None:
        pair = self._pair()
        if not pair:
            return
        one, other = pair
        urgent, void = self.chance.random() < 0.5, self.chance.choice([0.0, 1.0])
        way = f"{one.key}|{other.key}|thread{urgent}{self.asked}"
        ask = one.transport.mesh.ask

        def work() -> None:
            for number in range(1, 4):
                body = f"{way} {number}".encode()
                self._begin(body, one)
                void_at = one.process.runner.now() + void if void else 0.0
                on_reply = partial(self._reply, body, [])
                ask(other.key, body, void_at=void_at, urgent=urgent, on_reply=on_reply)

        one.process.runner.spawn(work, "asker")

    def _begin(self, body: bytes, asker: Member) -> None:
        self.asked += 1
        text = body.decode()
        self.open[text] = self.world.runner.now() + ENDS
        asker.process.on_exit.append(lambda: self.open.pop(text, None))

    def _reply(self, body: bytes, replies: list[bytes | None], reply: bytes | None) -> None:
        replies.append(reply)
        if reply is None:
            self._end(body, replies)

    def _end(self, body: bytes, replies: Iterable[bytes | None]) -> None:
        if self._over:  # the end of the world ends what is left
            return
        if self.open.pop(body.decode(), None) is None:
            self.complain(f"request {body!r} ends twice")
        if (got := list(replies)) not in (
            [None],
            [body, None],
            [b"progress", body, None],
            [b"progress", None],
        ):
            self.complain(f"request {body!r} gets {got}")
        self.answered += body in got

    def _publish(self) -> None:
        for one in self._ready():
            for _ in range(self.chance.choice([1, 1, 20])):
                number = one.next("state")
                self._on_loop(one, self._say(one, number))

    async def _say(self, one: Member, number: int) -> None:
        one.transport.publish(f"{one.key}/state", str(number).encode())

    def _announce(self) -> None:
        for one in self._ready()[:1]:
            key, seconds = f"view/{one.name}/{self.chance.randrange(3)}", self.chance.uniform(0.0, 2.0)
            self._on_loop(one, self._be_there(one, key, seconds))

    async def _be_there(self, one: Member, key: str, seconds: float) -> None:
        registrations = [
            await one.transport.announce(key),
            await one.transport.subscribe(f"{key}/state", lambda _key, _body: None),
        ]
        await asyncio.sleep(seconds)
        for registration in registrations:
            await registration.close()

    def _subscribe_in_a_thread(self) -> None:
        for one in self._pair():
            mesh, pattern = one.transport.mesh, f"robot/*/{self.chance.randrange(3)}/extra"
            runner, seconds = one.process.runner, self.chance.choice([0.0, 0.0, 0.5])
            for _ in range(2):
                runner.spawn(partial(self._subscribe, mesh, pattern, runner, seconds), "subscriber")

    def _subscribe(self, mesh: Mesh, pattern: str, runner: Any, seconds: float) -> None:
        number = mesh.subscribe(pattern, lambda _key, _body: None)
        runner.waiter().wait(seconds)
        mesh.unsubscribe(number)

    def _rival(self) -> None:
        """Two take one name at the same time; of two that see each other at most one has it."""
        for one in self._pair():
            self._on_loop(one, self._take_name(one))

    async def _take_name(self, one: Member) -> None:
        with contextlib.suppress(Occupied):
            mine = await one.transport.announce(f"host/only/{one.name}", unless=["host/only/*"])
            await one.transport.settle(0.5)
            await asyncio.sleep(0.2)
            await mine.close()

    # -- strangers --------------------------------------------------------------------------------

    def _visit(self, work: Callable[[SimulatedSystem], object]) -> None:
        """Have a process do something that is no member and ends with it."""
        machine, stranger = self.world.machine, VirtualProcess(self.world.runner, "stranger")
        system = machine.boot(stranger)

        def live() -> None:
            with contextlib.suppress(OSError):
                work(system)
            machine.end(stranger)

        stranger.spawn(live, "stranger")

    def _stop_by_a_command_line(self) -> None:
        """`robotree stop` is heard by each member that it could send it to, if nothing happens to that."""
        sent: list[str] = []
        before = {one: one.stops for one in self._ready() if self.quiet(one)}
        now = self.world.runner.now()

        def stop(system: SimulatedSystem) -> None:
            line = lean_stop.understood(["stop"])
            for tag in realms.members(FOLDER, system):
                if line is not None and (meant := realms.to_be_asked(FOLDER, tag, line.name, system)):
                    with contextlib.suppress(OSError):
                        lean_stop._tell(FOLDER, tag, meant, "order", system)
                        sent.extend(meant)

        def look() -> None:
            for one, stops in before.items():
                if one.key in sent and one in self._undisturbed_since(now) and one.stops == stops:
                    self.complain(f"{one.name} has not heard the stop of {now:.3f}")

        self._visit(stop)
        self._after(STOPPED, look)

    def _be_visited(self) -> None:
        """Somebody connects, many times or with nonsense, and soon goes."""
        found = [name for name in self.world.machine.folders.get(str(FOLDER), {}) if name.endswith(SOCKET)]
        if not found:
            return
        name, lines = self.chance.choice(sorted(found)), self.chance.choice([1, 1, 2, MOST_OF_ONE + 3])
        said = self.chance.choice([b"", b"\x05\x00\x00\x00x", self.chance.randbytes(40)])
        seconds = self.chance.choice([0.0, 0.3])

        def visit(system: SimulatedSystem) -> None:
            for _ in range(lines):
                system.dial(FOLDER / name).sendall(said)
                system.sleep(0.001)
            system.sleep(seconds)

        self._visit(visit)

    def _on_loop(self, one: Member, work: Any) -> None:
        async def run() -> None:
            with contextlib.suppress(VrError):
                await work

        if one.ready:
            one.process.loop.call_soon_threadsafe(lambda: one.process.loop.create_task(run()))
        else:
            work.close()

    # -- what goes wrong --------------------------------------------------------------------------

    def _faults(self) -> list[Callable[[], None]]:
        return [
            self._kill,
            self._kill,
            self._pause,
            self._pause,
            self._pause_all,
            self._leave,
            self._reset,
            self._stall,
            self._lose_folder,
            self._lose_file,
            self._fill_disk,
            self._take_descriptors,
        ]

    def _fault(self, fault: Callable[[], None]) -> None:
        self.faults += 1
        self.last_fault = self.world.runner.now()
        self.world.note("story", fault.__name__)
        fault()

    def _victim(self) -> Member:
        return self.chance.choice(list(self.members.values()))

    def _for(self, seconds: float, heal: Callable[[], object]) -> None:
        def over() -> None:
            heal()
            self.last_fault = self.world.runner.now()

        super()._for(seconds, over)

    def _kill(self) -> None:
        victim = self._victim()
        self._disturb(victim)
        victim.process.kill()

    def _pause(self) -> None:
        victim, seconds = self._victim(), self.chance.uniform(0.1, 5.0)
        self._disturb(victim)
        victim.process.pause()
        began = self.world.runner.now()

        def wake() -> None:
            process, now = victim.process, self.world.runner.now()
            same = self._disturbed[victim.name] == began  # else another pause has begun meanwhile
            if (
                same
                and self._starve < SEEN
                and process.alive
                and process.runner.halted
                and now - began > SILENT
            ):
                observers = self._undisturbed_since(began)
                self._expect_silent(victim, observers)
                self._after(SEEN, self._expect_awake, victim, observers, now)
            self._disturb(victim)
            process.resume()

        self._for(seconds, wake)

    def _undisturbed_since(self, moment: float) -> list[Member]:
        """Return the members that are there and to which nothing has happened since [s]."""
        if max(self._all_disturbed, self._all_slept) >= moment:
            return []
        return [one for one in self._ready() if self._disturbed[one.name] < moment]

    def _expect_silent(self, victim: Member, observers: list[Member]) -> None:
        for observer in observers:
            if victim.key in observer.transport.presence.keys("robot/*/*"):
                self.complain(f"{observer.name} takes {victim.name} for awake, which is frozen")

    def _expect_awake(self, victim: Member, observers: list[Member], since: float) -> None:
        """A member that goes on is seen at once."""
        if not victim.ready or self.last_fault > since:
            return
        for one in set(observers) & set(self._undisturbed_since(since - SILENT)):
            if victim.key not in one.transport.presence.keys("robot/*/*"):
                self.complain(f"{one.name} does not see that {victim.name} goes on")

    def _pause_all(self) -> None:
        """As a virtual machine does that is stopped: nobody has gone when it goes on."""
        members = list(self.members.values())
        began = self._all_slept = self.world.runner.now()
        for one in members:
            one.process.pause()

        def wake() -> None:
            self._all_slept = self.world.runner.now()
            slept = self._all_slept - began  # nobody could mend anything meanwhile
            self._all_disturbed += slept
            self._disturbed = {name: when + slept for name, when in self._disturbed.items()}
            for member in members:
                member.process.resume()

        self._for(self.chance.uniform(2.0, 4.0), wake)

    def _leave(self) -> None:
        victim = self._victim()
        self._disturb(victim)
        if victim.ready:
            victim.process.loop.call_soon_threadsafe(victim.leaves.set)

    def _links(self) -> list[SimulatedSocket]:
        one, other = self.chance.sample(list(self.members.values()), 2)
        self._disturb(one, other)
        return self.world.machine.links_between(one.process.runner, other.process.runner)

    def _reset(self) -> None:
        links = self._links()
        for end in links if self.chance.random() < 0.5 else links[:1]:
            end.reset()

    def _stall(self) -> None:
        for end in self._links():
            end.stalled = True
            self._disturb()
            self._for(self.chance.uniform(0.2, 3.0), end.go_on)

    def _lose_folder(self) -> None:
        self._disturb()
        self.world.machine.lose_folder(FOLDER)

    def _lose_file(self) -> None:
        self._disturb()
        entries = self.world.machine.folders.get(str(FOLDER), {})
        if entries:
            del entries[self.chance.choice(sorted(entries))]

    def _fill_disk(self) -> None:
        machine = self.world.machine
        self._disturb()
        machine.disk_full = True
        self._for(self.chance.uniform(0.2, 2.0), lambda: setattr(machine, "disk_full", False))

    def _take_descriptors(self) -> None:
        self._disturb()
        system = self._victim().process.system
        system.most_descriptors = len(system.descriptors) + STANDARD + 2
        self._for(
            self.chance.uniform(0.2, 2.0), lambda: setattr(system, "most_descriptors", MOST_DESCRIPTORS)
        )

    def _heal(self) -> None:
        super()._heal()
        self.world.machine.trouble = Trouble()
        self.world.runner.preemption.share = 0.0

    # -- the laws ---------------------------------------------------------------------------------

    def _probe(self) -> None:
        """Each asks each, and all publish."""
        members = list(self.members.values())
        for member in members:
            self._on_loop(member, self._say(member, member.next("state")))
            for other in members:
                self._on_loop(member, self._probe_one(member, other))

    async def _probe_one(self, one: Member, other: Member) -> None:
        before = self.answered
        await self._request(one, other, urgent=True)
        self.probes += self.answered > before

    def _check(self) -> None:
        self._over = True
        for text, latest in self.open.items():
            if latest < self.world.runner.now():
                self.complain(f"request {text} never ends")
        self.broken += [f"complaint: {complaint}" for complaint in self.world.complaints]
        self.broken += [f"logged: {one}" for one in self.world.logged]
        members = [member for member in self.members.values() if member.ready]
        if len(members) < MEMBERS:
            self.complain(f"only {len(members)} members have come back")
            return
        if self.probes != MEMBERS**2:
            self.complain(f"{self.probes} of {MEMBERS**2} last requests were answered")
        self.broken += network_is_whole([member.process for member in members])
        for member in members:
            self._check_member(member)

    def _check_member(self, one: Member) -> None:
        there = sorted(key for key, there in one.seen.items() if there)
        if there != one.transport.presence.keys("**"):
            self.complain(f"{one.name} was told that {there} are there")
        for other in self.members.values():
            if one.samples[f"{other.key}/state"] != other.numbers["state"]:
                self.complain(f"{one.name} has not heard the last sample of {other.name}")


def play(seed: int, among: tuple[ModuleType, ...] = ()) -> tuple[str, MeshStory]:
    """Play one seed to its end: see `play_on_machine`."""
    starve = AT_STATEMENTS if among else AT_CALLS
    return play_on_machine(partial(MeshStory, starve=starve), seed, among)
