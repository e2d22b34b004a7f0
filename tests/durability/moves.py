"""Kills at every boundary of moves: a robot goes to and fro between two hosts in the middle of a tour.

    python -m tests.durability.moves [--kills 500] [--seed 1] [--apart] [--minutes 60]

Each life of both hosts ends at a boundary of a move that chance has chosen, as the one that the robot leaves
or the other one, or at any moment; it is started again some time later. The robot's children write down each
thing that they do: one that was begun twice, or was left out, is counted; so is each moment in which two
hosts say that the robot acts there, and a robot that is nowhere, or in doubt, when both hosts are there.
With --apart the robot lives in a process of its own.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from robotree.vr.base.errors import VrError
from robotree.vr.base.permissions import Isolation
from tests.durability.stage import Counted, Program, Stage, beside, in_folder, options, staged

SOURCE = ("prepared", "frozen", "out", "answered", "gone")
DESTINATION = ("ready", "got", "logged", "served", "went")
APART = ("prepared", "out", "answered", "gone", "ready", "got", "logged", "served")
"""Those that the hosts pass of a robot in a process of its own."""
BLOCK = 25
"""Kills during one command."""
LONGEST = 120.0
"""[s] for the command to end after the last kill."""
STEPS = 3000
"""Of one command, at most: it takes longer than the kills."""


@dataclass
class Outcome(Counted):
    """What was counted."""

    moves: int = 0
    """That succeeded, as who asked was told."""
    owners: list[str] = field(default_factory=list[str])
    """When the robot had none, or several."""

    @property
    def good(self) -> bool:
        """Whether nothing was done twice, nothing is lost, and one host had the robot at any time."""
        return super().good and not self.owners


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
        await asyncio.wait([call], timeout=LONGEST)
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
            async with asyncio.timeout(LONGEST):
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
        latest = time.monotonic() + LONGEST
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


async def campaign(
    kills: int, seed: int, folder: Path, *, level: Isolation = "none", until: float = float("inf")
) -> Outcome:
    """Kill; returns what was counted.

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
            await Block(outcome, stage, chance, min(BLOCK, left), level=level).play(until)
        sys.stderr.write(f"{outcome.kills.total()} kills, {outcome.moves} moves, good: {outcome.good}\n")
    return outcome


def report(outcome: Outcome) -> str:
    """Return the figures as lines."""
    lines = [f"{count:5} {place}" for place, count in sorted(outcome.kills.items())]
    twice, lost, owners = len(outcome.twice), len(outcome.lost), len(outcome.owners)
    lines.append(
        f"{outcome.kills.total()} kills, {outcome.moves} moves, {outcome.steps} steps: {twice} twice,"
        f" {lost} lost, {owners} times not one owner; load {os.getloadavg()[0]:.1f}"
    )
    return "\n".join([*lines, *outcome.twice, *outcome.lost, *outcome.owners])


def main() -> int:
    """Play, and print the figures; the exit code is 0 if one host had the robot at any time."""
    parser = options(__doc__, 500)
    parser.add_argument("--apart", action="store_true")
    parser.add_argument("--minutes", type=float, default=float("inf"))
    chosen = parser.parse_args()
    level: Isolation = "process" if chosen.apart else "none"
    until = time.monotonic() + 60 * chosen.minutes
    outcome = in_folder(partial(campaign, chosen.kills, chosen.seed, level=level, until=until))
    sys.stdout.write(f"{report(outcome)}\n")
    return 0 if outcome.good and outcome.kills.total() >= chosen.kills else 1


if __name__ == "__main__":
    sys.exit(main())
