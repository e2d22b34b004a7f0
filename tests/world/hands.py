"""Stories of hands: operators of three sites get, ask for, offer, take and leave control, and hold keys.

Sites as in `sites.py`. The laws, judged by what the operators were told: after a robot has said to somebody
that they have control of it, it begins nothing for others until that person has given it away, or somebody
has taken it; and an attended command takes no step later than `ATTENTION` after the last key of its operator.
"""

from __future__ import annotations

import random
from functools import partial
from typing import Any

from robotree.vr import command
from robotree.vr.author.robot import Robot
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import VrError
from robotree.vr.core.machine import ATTENTION
from robotree.vr.exchange.attendance import Attendance
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.world import SimulatedProcess
from tests.world import sites
from tests.world.sites import SITES, Judge, Realm, Rover, SitesWorld, Story

LENGTH = 40.0
"""[s]"""
STEP = 0.1
"""[s] between two steps of an attended command."""
LATE = STEP + 0.1
"""[s] that a step may come later, with the way."""


class HandsJudge(Judge):
    """Knows who was told to have control, who asked for what, and who presses keys."""

    def __init__(self, world: SitesWorld) -> None:
        super().__init__(world)
        self.holder: dict[str, str] = {}
        """By rover: the site whose operator was told so, while nobody has done anything to change it."""
        self.askers: dict[float, str] = {}
        self.pressed: dict[float, float] = {}
        """[s] when the last key for a ticket was pressed."""
        self.steps = self.told = 0

    def begins(self, rover: Robot, ticket: float) -> None:
        name, asker = f"{rover.attributes['site']}:{rover.name}", self.askers[ticket]
        if (holder := self.holder.get(name, asker)) != asker:
            self.complain(f"{name} began what {asker} asked for, and {holder} has control of it")
        self.tickets.add(ticket)

    def goes_on(self, ticket: float) -> None:
        self.steps += 1
        late = self.world.runner.now() - self.pressed[ticket]
        if late > ATTENTION + LATE:
            self.complain(f"an attended command went on {late:.1f} s after the last key")


class Held(Rover):
    """A rover that tells the judge what it begins, and each step that somebody attends."""

    judge: HandsJudge  # type: ignore[assignment]

    @command
    def go(self, ticket: float) -> None:
        """Go a little."""
        self.judge.begins(self, ticket)
        self.sleep(0.3)

    @command(attended=True)
    def saw(self, ticket: float) -> None:
        """Go on while somebody holds a key."""
        while True:
            self.judge.goes_on(ticket)
            self.sleep(STEP)


class HandsRealm(Realm):
    """Sites with such rovers."""

    judge: HandsJudge

    def judge_of(self, world: SitesWorld) -> HandsJudge:
        return HandsJudge(world)

    async def _robot(self, process: SimulatedProcess, kind: type[Robot]) -> None:
        await super()._robot(process, Held if kind is Rover else kind)


class HandsStory(Story):
    """What happens."""

    realm: HandsRealm
    judge: HandsJudge

    def plan(self) -> None:
        at, chance = self._at, random.Random(f"{self.world.seed} hands")
        for _ in range(60):
            what = chance.choice(["get", "get", "ask", "offer", "take", "leave"])
            at(
                chance.uniform(4.0, LENGTH - 6),
                partial(self.control, chance.choice(SITES), what, "hall:rover"),
            )
        for _ in range(60):
            at(chance.uniform(4.0, LENGTH - 6), partial(self.go, chance.choice(SITES), "hall:rover"))
        for number in range(6):
            at(4.0 + 5.0 * number, partial(self.saw, "yard", chance.uniform(0.5, 3.0), chance.random() < 0.3))

    def control(self, site: str, what: Any, rover: str) -> None:
        """Have an operator get, ask for, offer, take or leave control."""
        self.judge.holder.pop(rover, None)  # from now on it may change hands, whoever asks

        async def ask(client: RealmClient) -> None:
            asked = self._changes = self._changes + 1
            holder = await client.control(rover, what)
            if asked == self._changes and holder.endswith(f"@{site}"):
                self.judge.holder[rover] = site
                self.judge.told += 1

        self.ask(site, ask, f"{what}s {rover}")

    _changes = 0

    def go(self, site: str, rover: str) -> None:
        """Have an operator call a command that moves."""
        self._ticket += 1
        ticket = self._ticket
        self.judge.askers[ticket] = site
        self.ask(site, lambda client: client.call(rover, "go", {"ticket": ticket}, deadline=5.0), "calls")

    def saw(self, site: str, seconds: float, pauses: bool) -> None:  # noqa: FBT001 # drawn
        """Hold a key for a while; then let go of it, or have the program stand still with the key held."""
        self._ticket += 1
        ticket, keys, now = self._ticket, Attendance(), self.world.runner.now
        self.judge.askers[ticket], self.judge.pressed[ticket] = site, now()
        process, began = self.realm.processes[f"{site}.operator"], now()

        def press() -> None:
            if now() < began + seconds:
                self.judge.pressed[ticket] = now()
                process.do(pressed, "presses")
                self._at(now() + 0.25, press)

        async def pressed() -> None:
            keys.press()

        async def call(client: RealmClient) -> None:
            try:
                await client.call(f"{site}:rover", "saw", {"ticket": ticket}, attendance=keys, deadline=30.0)
            except VrError:
                return

        self.ask(site, call, "saws")
        press()
        if pauses:
            self._at(began + seconds, process.pause)
            self._at(began + seconds + 1.5, process.resume)


def play(seed: int) -> tuple[str, HandsJudge]:
    """Play the story of a seed; returns the digest of its trace, and the judge."""
    with sitting_at("pts/1"):
        return sites.play(seed, HandsRealm, HandsStory, LENGTH)
