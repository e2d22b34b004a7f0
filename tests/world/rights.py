"""Stories of a policy: who may, may not any more, or is no member, while lines are cut and versions change.

Three sites as in `sites.py`. Their people call rovers everywhere; each version of the policy gives each site
other robots, and comes to each site at another moment, also while commands run. Then yard's key is revoked.

The laws are judged by the story's own tables, not by the policy's code: a command begins only where its asker
may have it carried out, and ends soon after that was withdrawn; who was revoked begins nothing at another
site; who may is served, who may not is told why, and everybody may stop.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from robotree.vr import command
from robotree.vr.author.robot import Robot
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import Denied, VrError
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.sites.keys import RealmKeys
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.supervision.stop import StopScope
from robotree.vr.world.world import SimulatedProcess
from tests.world import sites
from tests.world.sites import CALM, SITES, Judge, Realm, Rover, SitesWorld, Story

LENGTH = 68.0
"""[s] of a story; from `CALM` on nothing goes wrong any more."""
VERSIONS = 5
WITHDRAWN = 2.0
"""[s] that a command may go on after its asker's right was withdrawn where it runs."""
REVOKED = 10.0
"""[s] after which a revoked member is refused by all who are linked."""
STEP = 0.2
"""[s] between two looks of a robot at itself."""

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
        for _ in range(round(seconds / STEP)):
            self.sleep(STEP)
            judge.hauls(self, ticket, first=False)


class RightsRealm(Realm):
    """Sites that keep to a policy."""

    judge: RightsJudge

    def __init__(self, world: SitesWorld, folder: Path) -> None:
        self.gates = {site: PolicyGate() for site in SITES}
        for site, gate in self.gates.items():
            gate.site, world.networks[site].gate = site, gate
        super().__init__(world, folder)

    def judge_of(self, world: SitesWorld) -> RightsJudge:
        return RightsJudge(world)

    async def _robot(self, process: SimulatedProcess, kind: type[Robot]) -> None:
        await super()._robot(process, Hauler if kind is Rover else kind)


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
        self._ticket += 1
        ticket, name = self._ticket, f"{site}:rover"
        self.judge.askers[ticket] = asker

        async def call(client: RealmClient) -> None:
            await client.call(name, "haul", {"ticket": ticket, "seconds": seconds}, deadline=20.0)
            if ticket not in self.judge.tickets:
                self.judge.complain(f"ticket {ticket:g} succeeded and was never begun")

        self.ask(asker, call, f"calls {name}")

    def probe(self, asker: str, site: str) -> None:
        """In calm weather who may is served, and who may not is told why."""
        self._ticket += 1
        ticket, may = self._ticket, (asker, site) in self.judge.tables[site]
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


def play(seed: int) -> tuple[str, RightsJudge]:
    """Play the story of a seed; returns the digest of its trace, and the judge."""
    with sitting_at("pts/1"):
        return sites.play(seed, RightsRealm, RightsStory, LENGTH)
