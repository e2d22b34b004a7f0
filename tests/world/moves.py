"""Stories of robots that move between hosts, which end at any moment of that.

As in `crashes`, whose operators, failures and healing these are; besides robots move, in the middle of their
commands, with their children beside them or far away, and hosts end, lose their power or stand still at each
boundary of a move. The laws besides those of `crashes`: nobody acts at two hosts, and in the end each robot
is at exactly one, and known to be there.
"""

from __future__ import annotations

from collections.abc import Callable

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import VrError
from tests.world.crashes import BUILT, CALM, ROBOTS, CrashStory, KeepingJudge
from tests.world.crashes import play as play_story
from tests.world.keeping import MOMENTS, KeepingRealm

OF_MOVES = tuple(
    f"move {place}"
    for place in ("prepared", "frozen", "out", "answered", "gone", "ready", "got", "logged", "served", "went")
)
"""Moments of the host that a robot leaves, and of the other one."""


class MovingRealm(KeepingRealm):
    """A realm in which a robot may be known to two hosts."""

    def agents(self) -> dict[str, RobotAgent]:
        """Return the agents of all robots whose process runs, by name; of two the one that acts."""
        found = super().agents()
        return found | {agent.robot.name: agent for _, agent in self.acting()}

    def acting(self) -> list[tuple[str, RobotAgent]]:
        """Return the robots that act, each with its host."""
        return [
            (name, agent)
            for name, host in self.hosts.items()
            if self.processes[name].alive
            for agent in list(host.agents.values())
            if not (agent.gone or agent.runtime.is_on_way or _has_left(agent))
        ]


def _has_left(agent: RobotAgent) -> bool:
    ice = agent.runtime.ice
    return ice is not None and ice.moved


class MovingJudge(KeepingJudge):
    """Watches who acts where."""

    realm: MovingRealm

    def look(self) -> None:
        super().look()
        where: dict[str, str] = {}
        for host, agent in self.realm.acting():
            key = agent.address.key
            if key in where:
                self.complain(f"{agent.robot.name} acts at {where[key]} and at {host}")
            where[key] = host


class MoveStory(CrashStory):
    """What happens to one realm whose robots move."""

    realm_class, judge_class = MovingRealm, MovingJudge
    realm: MovingRealm
    moved = 0
    """Moves that succeeded, as who asked was told."""

    def plan(self) -> None:
        super().plan()
        for _ in range(self.chance.randrange(3, 9)):
            self.world.runner.at(self.chance.uniform(BUILT, CALM - 2.0), self._migrate)

    def _migrate(self) -> None:
        name = self.chance.choice(["guide", "guide", "helper"])
        to = self.chance.choice(["host-1", "host-2"])

        async def migrate() -> None:
            try:
                await self.realm.realm_clients["operator-1"].migrate(name, to)
            except VrError as error:
                self.world.note("operator-1", f"move {name} to {to}", f"{type(error).__name__}: {error}")
            else:
                self.moved += 1
                self.where[name] = to

        self._as_operator(migrate(), f"moves {name} to {to}")

    def _end_a_host(self) -> None:
        """Have a host end at a moment of a move, most often, and perhaps its next life, too."""
        chance, name = self.chance, self.chance.choice(["host-1", "host-2"])
        moments = [
            (chance.choice(OF_MOVES), chance.choice([1, 1, 1, 2]))
            if chance.random() < 0.7
            else (chance.choice(MOMENTS), chance.choice([1, 2, 3, 5, 8, 13, 21]))
            for _ in range(chance.choice([1, 1, 2]))
        ]
        self._arm(name, moments)

    def _deeds(self) -> list[Callable[[], None]]:
        """No old copy of a disk: it has robots that are elsewhere, and says so to nobody."""
        return [
            *[self._lose_power, self._pause_host, self._stop_and_release] * 2,
            self._cancel,
            self._kill_operator,
            self._kill_proxy,
            self._kill_two,
            self._call_spare,
        ]

    def _robots_of(self, host: str) -> list[str]:
        del host
        return list(self.where)

    def _check(self) -> None:
        super()._check()
        for robot in ROBOTS:
            hosts = [name for name, host in self.realm.hosts.items() if robot in host.agents]
            if len(hosts) != 1 or self.realm.hosts[hosts[0]].agents[robot].runtime.is_on_way:
                self.judge.complain(f"{robot} is at {hosts}, or nobody knows")


def play(seed: int) -> tuple[str, MoveStory]:
    """Play one seed to its end: see `crashes.play`."""
    digest, story = play_story(seed, MoveStory)
    assert isinstance(story, MoveStory)
    return digest, story
