"""Kills at every boundary of a step, of each kind of process and of two at once, and what came of the steps.

    python -m tests.durability.campaign [--kills 300] [--seed 1]
    python -m tests.durability.campaign --moves [--apart] [--minutes 60]

Two thirds of the kills are of hosts, at the places that `host.py` names, one of four with another host at the
same moment; the arms write down each thing that they do. The others are of a proxy, of the controller of a
rover, or of two of proxy, controller and host, when the controller begins or ends a goal: it writes each of
them down. A page of these trials repeats no step, so one that was begun twice was repeated by robotree.

With `--moves` a robot goes to and fro between two hosts in the middle of a tour. Each life of both ends at a
boundary of a move that chance has chosen, as the one that the robot leaves or the other one, or at any
moment; it is started again some time later. The robot's children write down each thing that they do: one that
was begun twice, or was left out, is counted; so is each moment in which two hosts say that the robot acts
there, and a robot that is nowhere, or in doubt, when both hosts are there. With `--apart` the robot lives in
a process of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import os
import random
import signal
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from robotree.vr.base.errors import VrError
from robotree.vr.base.permissions import Isolation
from tests.durability.stage import PAGES, Program, Stage, beside, in_folder, staged
from tests.ports import free_port

BOUNDARIES = {
    "before intent": "before write",
    "in the middle of the intent": "torn write",
    "after intent": "after write",
    "before send": "before send",
    "after send": "after send",
    "after effect": "reply came",
    "after the answer": "reply taken",
    "after done": "after step",
}
"""Places of `host.py`, by the boundary that they are."""
BLOCK = 20
"""Kills during one command."""
FURTHEST = 5
"""Moments of its kind after which a host ends at most."""
STEP = 1e-4
"""[m] between the ways of two steps, by which the controller's list tells them apart."""
PAIRS = (
    ("proxy",),
    ("controller",),
    ("host", "proxy"),
    ("host", "controller"),
    ("proxy", "controller"),
    ("proxy",),
    ("controller",),
)
LONGEST = 60.0
"""[s] for what a kill has interrupted to go on."""


SOURCE = ("prepared", "frozen", "out", "answered", "gone")
DESTINATION = ("ready", "got", "logged", "served", "went")
APART = ("prepared", "out", "answered", "gone", "ready", "got", "logged", "served")
"""Those that the hosts pass of a robot in a process of its own."""
TOUR = 25
"""Kills during one command."""
SETTLES = 120.0
"""[s] for the command to end after the last kill."""
STEPS = 3000
"""Of one command, at most: it takes longer than the kills."""


@dataclass
class Outcome:
    """What was counted."""

    kills: Counter[str] = field(default_factory=Counter[str])
    """By boundary or victims."""
    steps: int = 0
    twice: list[str] = field(default_factory=list[str])
    lost: list[str] = field(default_factory=list[str])
    moves: int = 0
    """That succeeded, as who asked was told."""
    owners: list[str] = field(default_factory=list[str])
    """When the robot had none, or several."""
    doubts: int = 0
    """Steps whose caller was told that they may have happened or not."""
    effects: list[float] = field(default_factory=list[float])
    """[s] from the start of a host's process to the next effect."""
    effects_of_two: list[float] = field(default_factory=list[float])
    """[s] the same where another host was killed with it."""

    @property
    def good(self) -> bool:
        """Whether nothing was done twice, nothing is lost, and one host had the robot at any time."""
        return not (self.twice or self.lost or self.owners)


# -- hosts --------------------------------------------------------------------------------------------


async def kill_hosts(outcome: Outcome, chance: random.Random, count: int, folder: Path) -> None:
    """Kill a host again and again in the middle of commands of the arms of a leaf."""
    names = list(BOUNDARIES)
    for block in range(0, count, BLOCK):
        place = folder / f"hosts-{block}"
        place.mkdir()
        two = block // BLOCK % 4 == 3
        chosen = [names[(block + number) % len(names)] for number in range(min(BLOCK, count - block))]
        kills = [f"{BOUNDARIES[name]} {chance.randint(1, FURTHEST)}" for name in chosen]
        kills[0] = (
            f"{BOUNDARIES[chosen[0]]} {FURTHEST}"  # when the command is accepted: else it may be refused
        )
        async with staged(place, f"hosts-{block}") as stage:
            host, second = stage.host("h1"), stage.host("h2")
            if two:
                await second.start()
                await stage.presence("host", "h2")
            await stage.furnish(host, kills.pop(0), other="h2" if two else "")
            steps = 8 * BLOCK
            async with beside(*([follow(host, second)] if two else [])):
                results = await stage.play(host, "tour", kills, patience=LONGEST, steps=steps)
            killed = host.lives - 1
            for name in chosen[:killed]:
                outcome.kills[f"host, {name}" + (", another host with it" if two else "")] += 1
            outcome.steps += steps
            outcome.twice += stage.twice()
            outcome.lost += [f"{place.name}: step {n}" for n in set(range(steps)) - set(stage.ended)]
            if results != [float(steps), float(steps)]:
                outcome.lost.append(f"{place.name}: the page has counted {results} of {steps} steps")
            (outcome.effects_of_two if two else outcome.effects).extend(next_effects(stage, host))


async def follow(first: Program, second: Program) -> None:
    """Kill a second host whenever the first one is killed, and start it again."""
    while True:
        lives = first.lives
        await first.process.wait()
        await second.kill()
        await second.start()
        while first.lives == lives:  # noqa: ASYNC110 # its keeper tells nobody
            await asyncio.sleep(0.005)


def next_effects(stage: Stage, host: Program) -> list[float]:
    """Return how long after each start of a host something was done; lives that did nothing are left out."""
    begun = [at for word, *_, at in stage.effects if word == "begin"]
    starts = [*host.started[1:], float("inf")]
    found: list[float] = []
    for start, following in itertools.pairwise(starts):
        effect = next((at for at in begun if at > start), None)
        if effect is not None and effect < following:
            found.append(effect - start)
    return found


# -- proxies and controllers --------------------------------------------------------------------------


class Rover:
    """A rover with its controller and its proxy, and a walker on top of it."""

    def __init__(self, stage: Stage) -> None:
        self.stage, self.goals = stage, stage.folder / "goals"
        url = f"tcp:127.0.0.1:{free_port()}"
        line, files = ("-m", "robotree.tui"), ("--state", stage.folder / "fence", "--log", self.goals)
        self.programs = {
            "controller": stage.program("controller", *line, "sim", "rover", "--listen", url, "--open",
                                        "--speedup", "10", *files),
            "proxy": stage.program("proxy", *line, "proxy", "rover", "rover-1", "--connect", url, "--open"),
            "host": stage.host("h1"),
        }  # fmt: skip

    async def begin(self) -> None:
        """Start all, and bind them."""
        for program in self.programs.values():
            await program.start()
        for role, name in (("host", "h1"), ("robot", "rover-1")):
            await self.stage.presence(role, name)  # type: ignore[arg-type]
        await self.stage.realm_client.create(str(PAGES), "walker", "h1", "Walker")
        await self.stage.presence("robot", "walker")
        await self.stage.realm_client.enslave("walker", "rover", "rover-1")

    def lines(self) -> list[list[str]]:
        """Return what the controller has written down: moment, word, key, and the rest."""
        text = self.goals.read_text() if self.goals.exists() else ""
        return [line.split() for line in text.splitlines()]

    async def kill(self, names: Sequence[str]) -> None:
        """Kill some processes at the same moment, and start them again."""
        victims = [self.programs[name] for name in names]
        for program in victims:
            with contextlib.suppress(ProcessLookupError):
                os.kill(program.process.pid, signal.SIGKILL)
        await asyncio.gather(*(program.process.wait() for program in victims))
        await asyncio.gather(*(program.start() for program in victims))


async def kill_below(outcome: Outcome, chance: random.Random, count: int, folder: Path) -> None:
    """Kill a proxy, a controller, or two of them and their host, while a page drives a rover."""
    place = folder / "below"
    place.mkdir()
    async with staged(place, "below") as stage:
        rover = Rover(stage)
        await rover.begin()
        told: dict[int, str] = {}
        ended = asyncio.Event()
        walk = asyncio.ensure_future(_walk(stage, told, ended))
        try:
            for number in range(count):
                names, word = PAIRS[number % len(PAIRS)], ("begin", "end")[number // len(PAIRS) % 2]
                await _goal(rover, word, walk)
                await asyncio.sleep(chance.uniform(0.0, 0.02))
                await rover.kill(names)
                outcome.kills[f"{' and '.join(names)}, after the {word} of a goal"] += 1
            await _goal(rover, "end", walk)
        finally:
            ended.set()
            await asyncio.wait((walk,), timeout=LONGEST)
        walk.result()
        count_goals(outcome, rover.lines(), told)


async def _walk(stage: Stage, told: dict[int, str], ended: asyncio.Event) -> None:
    """Have a page take steps, command by command; `told` gets what it says of each."""
    while not ended.is_set():
        first = len(told)
        arguments = {"first": first, "steps": 20}
        told.update(await stage.realm_client.call("walker", "walk", arguments, deadline=300.0))


async def _goal(rover: Rover, word: str, walk: asyncio.Future[None]) -> None:
    """Wait until the controller has begun a goal, and then until it begins or ends one."""
    for awaited in ("begin", word):
        before, latest = len(rover.lines()), time.monotonic() + LONGEST
        while not any(line[1] == awaited for line in rover.lines()[before:]):
            if walk.done():
                walk.result()
            assert time.monotonic() < latest, f"no goal {awaited}s\n{rover.stage.told()}"
            await asyncio.sleep(0.002)


def count_goals(outcome: Outcome, lines: Sequence[Sequence[str]], told: dict[int, str]) -> None:
    """Compare the controller's list with what the page was told of each step.

    Args:
        outcome: gets the figures.
        lines: `moment begin KEY verb V: ARGUMENTS`, or `moment end KEY STATE`.
        told: by number of the step: `done`, or the class of the error.
    """
    begun: Counter[int] = Counter()
    step_of: dict[str, int] = {}
    over: set[int] = set()
    for _, word, key, *rest in lines:
        if word == "begin":
            step_of[key] = round(abs(float(rest[2])) / STEP) - 100
            begun[step_of[key]] += 1
        elif rest[0] == "SUCCEEDED" and key in step_of:
            over.add(step_of[key])
    outcome.steps += len(told)
    outcome.twice += [f"below: step {n} was begun {times} times" for n, times in begun.items() if times > 1]
    outcome.lost += [
        f"below: step {n} is said to be done, and is not"
        for n, said in told.items()
        if said == "done" and n not in over
    ]
    outcome.doubts += sum(said != "done" for said in told.values())


# -- moves ------------------------------------------------------------------------------------------


class Block:
    """One tour during which hosts are killed."""

    def __init__(
        self, outcome: Outcome, stage: Stage, chance: random.Random, kills: int, *, level: Isolation = "none"
    ) -> None:
        self._outcome, self._stage, self._chance, self._left = outcome, stage, chance, kills
        self._level: Isolation = level
        self._places = (*SOURCE, *DESTINATION) if level == "none" else APART
        self.hosts = [stage.host("h1"), stage.host("h2")]
        self._armed: dict[Program, str] = {}

    async def play(self, until: float = float("inf")) -> None:
        """Play it; nobody is killed any more after `until`, [s] on the monotonic clock."""
        stage, outcome = self._stage, self._outcome
        for host in self.hosts:
            (stage.folder / f"{host.name}.journal").mkdir()  # so that its moments count from the start
        third = stage.host("h3")
        await third.start()
        await self.hosts[1].start(KILL=self._arm(self.hosts[1]))
        for name in ("h2", "h3"):
            await stage.presence("host", name)
        await stage.furnish(self.hosts[0], self._arm(self.hosts[0]), other="h3", level=self._level)
        call = asyncio.ensure_future(
            stage.realm_client.call("tourist", "tour", {"steps": STEPS, "pause": 0.05}, deadline=3600.0)
        )
        await stage.until_effects(3)
        async with beside(*map(self._keep_alive, self.hosts)):
            while self._left > 0 and not call.done() and time.monotonic() < until:
                await self._move()
            self._left = 0
            for host in self.hosts:
                self._armed[host] = ""
            await self._settled()
        done = len(set(stage.ended))
        await stage.realm_client.cancel("tourist")
        await asyncio.wait([call], timeout=SETTLES)
        await asyncio.gather(call, return_exceptions=True)
        outcome.steps += done
        outcome.twice += stage.twice()
        numbers = sorted(set(stage.ended))
        outcome.lost += [f"{stage.folder.name}: step {n}" for n in set(range(numbers[-1])) - set(numbers)]

    def _arm(self, host: Program) -> str:
        """Choose where the next life of a host ends."""
        place = self._chance.choice([*self._places, "any"])
        self._armed[host] = place
        return "" if place == "any" else f"move {place} 1"

    async def _move(self) -> None:
        """Have the robot go to the other host, and look who has it."""
        stage = self._stage
        with contextlib.suppress(VrError):
            here = (await stage.realm_client.describe("tourist")).host
            other = next(host.name for host in self.hosts if host.name != here)
            async with asyncio.timeout(SETTLES):
                await stage.realm_client.migrate("tourist", other)
            self._outcome.moves += 1
        await self._look()
        await asyncio.sleep(0.05)

    async def _look(self) -> list[str]:
        """Return which hosts say that the robot acts there; several are noted."""
        with contextlib.suppress(VrError):
            hosts = await self._stage.realm_client.hosts()
            found = [
                host.address.name
                for host in hosts
                if "tourist" in {robot.name for robot in host.robots} and "tourist" not in host.on_way
            ]
            if len(found) > 1:
                self._outcome.owners.append(f"{self._stage.folder.name}: {found}")
            return found
        return []

    async def _settled(self) -> None:
        """Wait until the robot is known to be at one host; note it if it never is."""
        latest = time.monotonic() + SETTLES
        while time.monotonic() < latest:
            if len(await self._look()) == 1 and all(host.runs for host in self.hosts):
                return
            await asyncio.sleep(0.1)
        self._outcome.owners.append(f"{self._stage.folder.name}: nobody\n{self._stage.told()}")

    async def _keep_alive(self, host: Program) -> None:
        """Start a host again whenever it has ended, to be killed again; kill it now if it is its turn."""
        while True:
            place = self._armed[host]
            if place == "any":
                await asyncio.sleep(self._chance.uniform(0.1, 2.0))
                if self._armed[host] == "any":
                    host.process.kill()
            await host.process.wait()
            self._outcome.kills[place or self._armed[host] or "late"] += 1
            self._left -= 1
            await asyncio.sleep(self._chance.choice([0.0, 0.1, 0.5]))
            if self._left > 0:
                await host.start(KILL=self._arm(host))
            else:
                self._armed[host] = ""
                await host.start(KILL="")


async def kill_movers(
    kills: int, seed: int, folder: Path, *, level: Isolation = "none", until: float = float("inf")
) -> Outcome:
    """Kill hosts between which a robot moves; returns what was counted.

    Args:
        kills: how often.
        seed: of chance.
        folder: for what the hosts keep.
        level: how the robot is kept apart.
        until: [s] on the monotonic clock, after which nobody is killed any more.
    """
    outcome, chance = Outcome(), random.Random(seed)
    while (left := kills - outcome.kills.total()) > 0 and time.monotonic() < until:
        place = folder / f"moves-{outcome.kills.total()}"
        place.mkdir()
        async with staged(place, place.name) as stage:
            await Block(outcome, stage, chance, min(TOUR, left), level=level).play(until)
        sys.stderr.write(f"{outcome.kills.total()} kills, {outcome.moves} moves, good: {outcome.good}\n")
    return outcome


# -- all ----------------------------------------------------------------------------------------------


async def campaign(kills: int, seed: int, folder: Path) -> Outcome:
    """Play all trials.

    Args:
        kills: how many there are; two of three of hosts.
        seed: of all chance.
        folder: for what is written down.
    """
    outcome, chance = Outcome(), random.Random(seed)
    hosts = kills * 2 // 3
    await kill_hosts(outcome, chance, hosts, folder)
    await kill_below(outcome, chance, kills - hosts, folder)
    return outcome


def python_starts() -> float:
    """Return how long Python takes to start with nothing, median [s]."""
    times: list[float] = []
    for _ in range(9):
        began = time.monotonic()
        subprocess.run([sys.executable, "-c", ""], check=True)
        times.append(time.monotonic() - began)
    return statistics.median(times)


def report(outcome: Outcome) -> str:
    """Return the figures as lines."""
    lines = [f"{count:5} {what}" for what, count in sorted(outcome.kills.items())]
    twice, lost = len(outcome.twice), len(outcome.lost)
    lines.append(f"{outcome.kills.total()} kills in {outcome.steps} steps: {twice} twice, {lost} lost")
    lines.append(f"{outcome.doubts} steps were told to their page as errors")
    lines.append(f"{outcome.moves} moves, {len(outcome.owners)} times not one owner")
    for what, times in (("one host", outcome.effects), ("two", outcome.effects_of_two)):
        if len(times) > 1:
            quantiles = statistics.quantiles(times, n=20, method="inclusive")
            figures = f"p50 {quantiles[9]:.2f} s, p95 {quantiles[18]:.2f}, max {max(times):.2f}"
            lines.append(f"process of {what} to the next effect: {figures}, {len(times)} restarts")
    lines.append(f"Python itself: {python_starts():.2f} s; load {os.getloadavg()[0]:.1f}")
    return "\n".join([*lines, *outcome.twice, *outcome.lost, *outcome.owners])


def main() -> int:
    """Play, and print the figures; the exit code is 0 if all is good and there were enough kills."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--moves", action="store_true", help="kill the hosts between which a robot moves")
    parser.add_argument("--apart", action="store_true", help="the robot that moves has a process of its own")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="for the moves")
    chosen = parser.parse_args()
    play = partial(campaign, chosen.kills, chosen.seed)
    if chosen.moves:
        level: Isolation = "process" if chosen.apart else "none"
        until = time.monotonic() + 60 * chosen.minutes
        play = partial(kill_movers, chosen.kills, chosen.seed, level=level, until=until)
    try:
        outcome = in_folder(play)
    except VrError as error:
        sys.stdout.write(f"a command has not gone on: {error}\n")
        return 1
    sys.stdout.write(f"{report(outcome)}\n")
    return 0 if outcome.good and outcome.kills.total() >= chosen.kills else 1


if __name__ == "__main__":
    sys.exit(main())
