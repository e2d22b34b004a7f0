"""Stories of rights and of hands: who may command, and who of those has control, at three sites (`sites.py`).

Of a policy: people call rovers everywhere; each version of it gives each site other robots, and comes to each
site at another moment, also while commands run. Then yard's key is revoked. The laws are judged by the
story's own tables, not by the policy's code: a command begins only where its asker may have it carried out,
and ends soon after that was withdrawn; who was revoked begins nothing at another site; who may is served, who
may not is told why, and everybody may stop.

Of hands: operators get, ask for, offer, take and leave control, and hold keys. The laws, judged by what the
operators were told: after a robot has said to somebody that they have control of it, it begins nothing for
others until that person has given it away, or somebody has taken it; and an attended command takes no step
later than `ATTENTION` after the last key of its operator.
"""

from __future__ import annotations

import random
from functools import partial
from pathlib import Path
from typing import Any

from robotree.vr import command
from robotree.vr.author.robot import Robot
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import Denied, VrError
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.core.machine import ATTENTION
from robotree.vr.exchange.attendance import Attendance
from robotree.vr.sites.keys import RealmKeys
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.supervision.stop import StopScope
from tests.world import sites
from tests.world.sites import CALM, SITES, Judge, Realm, Rover, SitesWorld, Story

RIGHTS_LENGTH = 68.0
"""[s] of a story; from `CALM` on nothing goes wrong any more."""
VERSIONS = 5
WITHDRAWN = 2.0
"""[s] that a command may go on after its asker's right was withdrawn where it runs."""
REVOKED = 10.0
"""[s] after which a revoked member is refused by all who are linked."""
HAUL_STEP = 0.2
"""[s] between two looks of a robot at itself."""

HANDS_LENGTH = 40.0
"""[s]"""
SAW_STEP = 0.1
"""[s] between two steps of an attended command."""
LATE = SAW_STEP + 0.1
"""[s] that a step may come later, with the way."""

Table = frozenset[tuple[str, str]]
"""Which site's people may command the rover of which site."""
EVERYTHING: Table = frozenset((asker, site) for asker in SITES for site in SITES)


class RightsJudge(Judge):
    """Knows which table is in force where."""

    def __init__(self, world: SitesWorld) -> None:
        super().__init__(world)
        self.tables: dict[str, Table] = dict.fromkeys(SITES, EVERYTHING)
        self.withdrawn: dict[tuple[str, str], float] = {}
        """When a right ended at the site of the rover [s]."""
        self.askers: dict[float, str] = {}
        """Whose ticket it is."""
        self.revoked = float("inf")
        """[s] when all know that yard is no member."""

    def change(self, site: str, table: Table) -> None:
        """Another table is in force at a site."""
        now = self.world.runner.now()
        for asker, rover in self.tables[site] - table:
            self.withdrawn[asker, rover] = now
        self.tables[site] = table

    def hauls(self, rover: Robot, ticket: float, *, first: bool) -> None:
        """A rover begins a command, or goes on with it."""
        now, site, asker = self.world.runner.now(), rover.attributes["site"], self.askers[ticket]
        what = f"{site}:rover {'began' if first else 'went on with'} what {asker} asked for"
        if (asker, site) not in self.tables[site]:
            patience = 0.0 if first else WITHDRAWN
            if now > self.withdrawn.get((asker, site), 0.0) + patience:
                self.complain(f"{what}, and may not")
        if first and asker == "yard" and site != "yard" and now > self.revoked:
            self.complain(f"{what}, and is no member any more")
        self.tickets.add(ticket)


class Hauler(Rover):
    """A rover with a command that takes longer."""

    @command
    def haul(self, ticket: float, seconds: float) -> None:
        """Haul."""
        judge = self.judge
        assert isinstance(judge, RightsJudge)
        judge.hauls(self, ticket, first=True)
        for _ in range(round(seconds / HAUL_STEP)):
            self.sleep(HAUL_STEP)
            judge.hauls(self, ticket, first=False)


class RightsRealm(Realm):
    """Sites that keep to a policy."""

    judge_class, rover_class = RightsJudge, Hauler
    judge: RightsJudge

    def __init__(self, world: SitesWorld, folder: Path) -> None:
        self.gates = {site: PolicyGate() for site in SITES}
        for site, gate in self.gates.items():
            gate.site, world.networks[site].gate = site, gate
        super().__init__(world, folder)


class RightsStory(Story):
    """What happens."""

    realm: RightsRealm
    judge: RightsJudge
    faults, terms = ("cut", "lossy", "hub", "gateway"), (0.5, 1.5, 6.5)
    """No pauses: what stands still ends nothing."""

    def plan(self) -> None:
        at, chance = self._at, self.chance
        for site in SITES:
            self.arrive(site, 1, EVERYTHING)
        for version in range(2, VERSIONS + 2):
            table = frozenset(one for one in sorted(EVERYTHING) if chance.random() < 0.6)
            when = 5.0 + (version - 2) * (CALM - 10.0) / VERSIONS
            for site in SITES:
                at(when + chance.uniform(0.0, 4.0), partial(self.arrive, site, version, table))
        for _ in range(40):
            when, asker = chance.uniform(4.0, CALM), chance.choice(SITES)
            at(when, partial(self.haul, asker, chance.choice(SITES), chance.choice([0.4, 2.0, 8.0])))
        for _ in range(5):
            at(chance.uniform(6.0, CALM - 2.0), self.fault)
        at(CALM, self.heal)
        last = EVERYTHING - {("hall", site) for site in SITES}
        for site in SITES:
            at(CALM + 1.0, partial(self.arrive, site, VERSIONS + 2, last))
        at(CALM + 8.0, self.revoke)
        for number in range(5):
            for asker, site in (("yard", "lab"), ("yard", "hall")):
                at(CALM + 16.0 + number, partial(self.haul, asker, site, 0.4))
        for number, (asker, site) in enumerate(
            [("lab", "lab"), ("lab", "hall"), ("hall", "hall"), ("hall", "lab")]
        ):
            at(CALM + 12.0 + 2.0 * number, partial(self.probe, asker, site))
        at(CALM + 22.0, self.stop_all)

    def arrive(self, site: str, version: int, table: Table) -> None:
        """A version of the policy comes to a site; an older one changes nothing."""
        gate = self.realm.gates[site]
        if gate.policy is not None and gate.policy.version >= version:
            return
        lines = [f"realm: plant\nversion: {version}\npersons:"]
        lines += [f'  "*@{asker}": {asker}' for asker in SITES]
        lines.append("roles:")
        for asker in SITES:
            may = ", ".join(f'"{rover}:rover"' for one, rover in sorted(table) if one == asker)
            lines.append(f'  {asker}: {{see: "*", command: [{may}]}}' if may else f'  {asker}: {{see: "*"}}')
        gate.policy = read_policy("\n".join(lines))
        self.judge.change(site, table)
        self.world.note(site, "policy", version)

    def haul(self, asker: str, site: str, seconds: float) -> None:
        """Have a site's person call a rover."""
        ticket, name = self.new_ticket(), f"{site}:rover"
        self.judge.askers[ticket] = asker

        async def call(client: RealmClient) -> None:
            await client.call(name, "haul", {"ticket": ticket, "seconds": seconds}, deadline=20.0)
            if ticket not in self.judge.tickets:
                self.judge.complain(f"ticket {ticket:g} succeeded and was never begun")

        self.ask(asker, call, f"calls {name}")

    def probe(self, asker: str, site: str) -> None:
        """In calm weather who may is served, and who may not is told why."""
        ticket, may = self.new_ticket(), (asker, site) in self.judge.tables[site]
        self.judge.askers[ticket] = asker

        async def call(client: RealmClient) -> None:
            try:
                await client.call(f"{site}:rover", "haul", {"ticket": ticket, "seconds": 0.2}, deadline=10.0)
            except Denied as denied:
                if may:
                    self.judge.complain(f"{asker} may, and was refused: {denied}")
                return
            except VrError as error:
                self.judge.complain(f"{asker} was not answered by {site}: {error!r}")
                return
            if not may:
                self.judge.complain(f"{asker} may not, and was served by {site}")

        self.ask(asker, call, f"probes {site}")

    def revoke(self) -> None:
        """Yard is no member any more, and does not want to know; lab is the authority."""
        yard: Any = self.realm.gateways["yard"]._keys  # of a liar
        yard.take_revocations = lambda *_: False
        RealmKeys(self.realm.folder / "lab" / "keys").revoke("yard")
        self.judge.revoked = self.world.runner.now() + REVOKED

    def stop_all(self) -> None:
        """Who may command nothing stops everything."""

        async def stop(client: RealmClient) -> None:
            told = await client.stop(None, scope=StopScope(["lab"]))
            if not {"rover", "lab:rover"} <= {name.removeprefix("hall:") for name in told}:
                self.judge.complain(f"a stop by who may nothing else stopped {sorted(told)} only")

        self.ask("hall", stop, "stops")


def play_rights(seed: int) -> tuple[str, RightsJudge]:
    """Play the story of a seed; returns the digest of its trace, and the judge."""
    with sitting_at("pts/1"):
        return sites.play(seed, RightsRealm, RightsStory, RIGHTS_LENGTH)


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
            self.sleep(SAW_STEP)


class HandsRealm(Realm):
    """Sites with such rovers."""

    judge_class, rover_class = HandsJudge, Held


class HandsStory(Story):
    """What happens."""

    realm: HandsRealm
    judge: HandsJudge

    def plan(self) -> None:
        at, chance = self._at, random.Random(f"{self.world.seed} hands")
        for _ in range(60):
            what = chance.choice(["get", "get", "ask", "offer", "take", "leave"])
            at(
                chance.uniform(4.0, HANDS_LENGTH - 6),
                partial(self.control, chance.choice(SITES), what, "hall:rover"),
            )
        for _ in range(60):
            at(chance.uniform(4.0, HANDS_LENGTH - 6), partial(self.go, chance.choice(SITES), "hall:rover"))
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
        ticket = self.new_ticket()
        self.judge.askers[ticket] = site
        self.ask(site, lambda client: client.call(rover, "go", {"ticket": ticket}, deadline=5.0), "calls")

    def saw(self, site: str, seconds: float, pauses: bool) -> None:  # noqa: FBT001 # drawn
        """Hold a key for a while; then let go of it, or have the program stand still with the key held."""
        ticket, keys, now = self.new_ticket(), Attendance(), self.world.runner.now
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


def play_hands(seed: int) -> tuple[str, HandsJudge]:
    """Play the story of a seed; returns the digest of its trace, and the judge."""
    with sitting_at("pts/1"):
        return sites.play(seed, HandsRealm, HandsStory, HANDS_LENGTH)
