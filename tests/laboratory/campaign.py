"""Kills, stops and cuts of every hub, gateway, host, lookup and site in turn, and what came of the robots.

    python -m tests.laboratory.campaign [--faults 200] [--seed 1] [--limit 1800] [--only kill:hub-1,cut:yard]

Three sites and two hubs. At each site a tree of its own works all the time; a robot of one site commands one
of another site, and a person at the third one commands a robot there. Each fault is healed after 0.2 to 8 s;
then all sites must see all robots again. In the end it is counted what the leaves have written down.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import itertools
import json
import random
import signal
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from robotree.vr.base.errors import VrError
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import ReadEvents
from robotree.vr.history.file import HistoryFile
from tests.laboratory.laboratory import HUBS, REALM, ROBOTS, SITES, Laboratory, Loopback, best

DELAY, LOSS = 0.04, 0.01
"""[s] one way between a site and a hub, and the share of segments that are lost."""
HEALS = 60.0
"""[s] within which all must see all again after a fault is healed."""
SHORTEST, LONGEST = 0.2, 8.0
"""[s] of a fault."""
PATIENCE = 5.0
"""[s] within which a call of a person must be done."""
SETTLES = 7.0
"""[s] after a fault of a host within which its own tree waits for the end of a lease that it has cost."""
LATE = 0.5
"""[s] beside it: for the clock that starts when the call is made, and for a write that is under way."""


@dataclass
class Call:
    """A call of the person at yard."""

    n: int
    made: float
    """[s since 1970]"""
    over: float = 0.0
    error: str = ""


@dataclass
class Result:
    """What was counted."""

    ground: str = ""
    seed: int = 1
    faults: Counter[str] = field(default_factory=Counter[str])
    lost: list[str] = field(default_factory=list[str])
    """Robots that were not seen again, or things that were answered and not done."""
    heal: dict[str, list[float]] = field(default_factory=dict[str, list[float]])
    """[s] from the end of a fault until each site saw all robots and had answers of all sites, by kind."""
    stale: list[str] = field(default_factory=list[str])
    """Commands of an older epoch that were accepted."""
    late: list[str] = field(default_factory=list[str])
    """Things that began after who asked was told that they would not."""
    twice: list[str] = field(default_factory=list[str])
    replayed: int = 0
    """Things that the code of a page did again, because its host was killed while it did them."""
    works: Counter[str] = field(default_factory=Counter[str])
    """Things that leaves have done, by leaf."""
    gap: float = 0.0
    """[s] the longest pause of a tree of a site while no process of the site's own trees was struck."""
    gap_where: str = ""
    bonds: int = 0
    """Times that the bond between two sites was made anew."""
    calls: Counter[str] = field(default_factory=Counter[str])
    """Calls of the person, by how they ended."""
    round_trips: list[float] = field(default_factory=list[float])
    """[s] of those that ended well."""
    wall: float = 0.0

    @property
    def good(self) -> bool:
        return bool(self.faults) and not (self.lost or self.stale or self.late or self.twice)


class Campaign:
    """See the module."""

    def __init__(self, laboratory: Laboratory, seed: int) -> None:
        self.laboratory, self.chance = laboratory, random.Random(seed)
        self.result = Result(laboratory.ground.name, seed)
        self.calls: list[Call] = []
        self.struck: dict[str, list[tuple[float, float]]] = {site: [] for site in SITES}
        """[s since 1970] From when to when the host of a site was struck."""
        self._numbers = itertools.count(1)
        self._over = False

    def plan(self, only: str) -> list[str]:
        """Return the faults of one round."""
        if only:
            return only.split(",")
        victims = [*HUBS, *(f"{what}-{site}" for site in SITES for what in ("gateway", "host", "lookup"))]
        plan = [f"{how}:{victim}" for victim in victims for how in ("kill", "stop")]
        plan += [f"cut:{site}" for site in SITES] * 2
        self.chance.shuffle(plan)
        return plan

    async def run(self, faults: int, limit: float, only: str) -> Result:
        """Play, and count."""
        began = time.monotonic()
        working = [asyncio.ensure_future(self._local(site)) for site in SITES]
        working += [asyncio.ensure_future(self._across()), asyncio.ensure_future(self._person())]
        plan = list[str]()
        with contextlib.suppress(asyncio.CancelledError):
            while self.result.faults.total() < faults and time.monotonic() - began < limit:
                plan = plan or self.plan(only)
                await self._strike(plan.pop(0))
        await asyncio.sleep(PATIENCE + 2)  # what is under way ends
        self._over = True
        await asyncio.wait_for(asyncio.gather(*working), 120)
        self._count(await asyncio.to_thread(self._histories))
        self.result.wall = time.monotonic() - began
        return self.result

    async def _strike(self, fault: str) -> None:
        """Do it, heal it, and wait until all see all."""
        how, _, victim = fault.partition(":")
        seconds = self.chance.choice((self.chance.uniform(SHORTEST, 2.0), self.chance.uniform(1.0, LONGEST)))
        began, site = time.time(), victim.partition("-")[2]
        if how == "cut":
            await self.laboratory.ground.cut(victim)
            await asyncio.sleep(seconds)
            await self.laboratory.ground.mend(victim)
        else:
            process = self.laboratory.processes[victim]
            process.process.send_signal(signal.SIGKILL if how == "kill" else signal.SIGSTOP)
            await asyncio.sleep(seconds)
            if how == "kill":
                await process.kill()
                await process.start()
            else:
                process.process.send_signal(signal.SIGCONT)
        self.result.faults[fault] += 1
        healed = time.monotonic()
        try:
            await asyncio.wait_for(self._whole(), HEALS)
            self.result.heal.setdefault(kind_of(fault), []).append(time.monotonic() - healed)
        except (TimeoutError, AssertionError):
            missing = self.laboratory.missing() or ["all are seen, and not all answer"]
            self.result.lost.append(f"{self.result.faults.total()} {fault}: {'; '.join(missing[:4])}")
        if victim.startswith("host"):
            self.struck[site].append((began, time.time()))
        if self.result.faults.total() % 10 == 0:
            slowest = max(itertools.chain([0.0], *self.result.heal.values()))
            lost = len(self.result.lost)
            sys.stderr.write(f"{self.result.faults.total()} faults, {lost} lost, slowest {slowest:.1f} s\n")
            sys.stderr.flush()

    async def _whole(self) -> None:
        """Wait until each site sees all robots, and a robot of each other site answers."""
        for site, client in self.laboratory.clients.items():
            for other in SITES:
                while other != site:
                    with contextlib.suppress(VrError):
                        await client.describe(f"leaf-{other}")
                        break
                    await asyncio.sleep(0.05)
        await self.laboratory.until(lambda: not self.laboratory.missing(), "all see all", HEALS)

    # -- what goes on meanwhile -------------------------------------------------------------------

    async def _local(self, site: str) -> None:
        """Have the tree of a site work."""
        while not self._over:
            first = next(self._numbers) * 1000
            try:
                await self.laboratory.clients[site].call(
                    f"cell-{site}", "tour", {"first": first, "steps": 40}, deadline=60.0
                )
            except VrError:
                await asyncio.sleep(0.1)

    async def _across(self) -> None:
        """Have a robot of one site command one of another, and bind it again when the bond has ended."""
        client = self.laboratory.clients["lab"]
        while not self._over:
            first = next(self._numbers) * 1000
            try:
                await client.call("chief", "tour", {"first": first, "steps": 4}, deadline=20.0)
            except VrError:
                await asyncio.sleep(0.5)
                with contextlib.suppress(VrError):
                    await client.enslave("chief", "leaf", "far")
                    self.result.bonds += 1

    async def _person(self) -> None:
        """Command a robot of another site."""
        client, robot = self.laboratory.clients["yard"], "open-lab"
        while not self._over:
            call = Call(next(self._numbers) * 1000, time.time())
            self.calls.append(call)
            try:
                await client.call(robot, "work", {"n": call.n}, deadline=PATIENCE)
            except VrError as error:
                call.error = type(error).__name__
            call.over = time.time()
            await asyncio.sleep(0.3)

    # -- what came of it --------------------------------------------------------------------------

    def _histories(self) -> dict[str, list[HistoryEvent]]:
        found: dict[str, list[HistoryEvent]] = {}
        for site, robots in (("hall", ("far",)), ("lab", ("open-lab",))):
            top = self.laboratory.folder / site / "state" / "robotree" / REALM / "hosts"
            for robot in robots:
                found[robot] = []
                for path in top.glob("*/history.db"):
                    file = HistoryFile(path)
                    read = file.read(ReadEvents(robot=robot, most=1_000_000))
                    found[robot] += [one.event for one in read.events]
                    file.close()
        return found

    def _count(self, histories: dict[str, list[HistoryEvent]]) -> None:
        result, done = self.result, dict[str, list[tuple[int, float]]]()
        for line in self.laboratory.effects.read_text().splitlines():
            robot, n, unix = line.split()
            done.setdefault(robot, []).append((int(n), float(unix)))
        for robot, found in done.items():
            result.works[robot] = len(found)
            site = next(site for site, robots in ROBOTS.items() if robot in robots)
            first = dict[int, float]()
            for n, unix in found:
                if n not in first:
                    first[n] = unix
                elif any(begin < unix and first[n] < end for begin, end in self.struck[site]):
                    result.replayed += 1
                else:
                    result.twice.append(f"{robot} {n}")
        for events in histories.values():
            result.stale += stale_in(events)
        self._count_calls(dict(done.get("open-lab", ())))
        for site in SITES:
            self._gaps(site, [unix for _, unix in done.get(f"leaf-{site}", ())])

    def _count_calls(self, at: dict[int, float]) -> None:
        """Compare what the person was told with when the robot did it [s since 1970]."""
        for call in self.calls:
            self.result.calls[call.error or "done"] += 1
            if not call.error:
                self.result.round_trips.append(call.over - call.made)
                if call.n not in at:
                    self.result.lost.append(f"call {call.n} was answered and not carried out")
            elif call.n in at and at[call.n] > max(call.over, call.made + PATIENCE) + LATE:
                late = at[call.n] - call.over
                self.result.late.append(f"call {call.n}: {late:.2f} s after {call.error}")

    def _gaps(self, site: str, moments: Sequence[float]) -> None:
        for before, after in itertools.pairwise(moments):
            if any(begin < after and before < end + SETTLES for begin, end in self.struck[site]):
                continue
            if after - before > self.result.gap:
                self.result.gap, self.result.gap_where = after - before, site


def stale_in(events: Sequence[HistoryEvent]) -> list[str]:
    """Return the commands that a robot has accepted under an older epoch than one it had obeyed before."""
    newest, found = 0, list[str]()
    for event in events:
        if event.kind == "accepted" and 0 < event.epoch < newest:
            found.append(f"{event.robot} {event.key} of {event.epoch} after {newest}")
        if event.kind in {"accepted", "lease"}:
            newest = max(newest, event.epoch)
    return found


def kind_of(fault: str) -> str:
    """Return the kind of a fault: what is done to what."""
    how, _, victim = fault.partition(":")
    return f"{how} {'site' if how == 'cut' else victim.partition('-')[0]}"


def report(result: Result) -> str:
    """Return what was counted, as Markdown."""
    trips, kinds = result.round_trips or [0.0], Counter[str]()
    for fault, count in result.faults.items():
        kinds[kind_of(fault)] += count
    struck = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    ends = ", ".join(
        f"{kind} {statistics.median(took):.1f} / {max(took):.1f} s"
        for kind, took in sorted(result.heal.items())
    )
    calls = f"{dict(result.calls)}; done in p50 {statistics.median(trips):.2f} s, max {max(trips):.2f} s"
    where = f"seed {result.seed}, {result.ground}, {result.wall:.0f} s"
    rows = {
        f"faults ({where})": f"{result.faults.total()}: {struck}",
        "robots lost after healing, or calls answered and not carried out": len(result.lost),
        "commands of a stale epoch": len(result.stale),
        "begun after who asked had been told that nothing begins": len(result.late),
        "carried out twice": f"{len(result.twice)} of {result.works.total()}",
        "interrupted by a kill of their own host, and begun anew by it": result.replayed,
        "from the end of a fault until each site saw and reached all others, p50 / max": ends,
        "longest pause of a site's tree, its host not struck": f"{result.gap:.2f} s ({result.gap_where})",
        "the bond across sites was made anew": f"{result.bonds} times",
        "calls of a person at another site": calls,
    }
    first, *rest = (f"| {what} | {found} |" for what, found in rows.items())
    lines = [first, "|---|---|", *rest]
    for name in ("lost", "stale", "late", "twice"):
        lines += [f"* {name}: {one}" for one in getattr(result, name)[:20]]
    return "\n".join(lines)


async def play(seed: int, faults: int, limit: float, only: str, *, loopback: bool) -> Result:
    """Open the laboratory, play, close it."""
    ground = Loopback(DELAY, LOSS, 0.0) if loopback else best(DELAY, LOSS)
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        laboratory = Laboratory(Path(folder), ground)
        try:
            await laboratory.open()
            return await Campaign(laboratory, seed).run(faults, limit, only)
        finally:
            await laboratory.close()


def main() -> int:
    """Read the line, run the campaign, write what was counted."""
    parser = argparse.ArgumentParser(prog="python -m tests.laboratory.campaign", description=__doc__)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=1800.0, help="[s] after which no further fault begins")
    parser.add_argument("--only", default="", help="faults, as HOW:VICTIM, with commas")
    parser.add_argument("--loopback", action="store_true", help="no namespaces, also where they are allowed")
    parser.add_argument("--json", action="store_true", help="print one JSON line instead of the table")
    given = parser.parse_args()
    for one in (signal.SIGINT, signal.SIGTERM):
        signal.signal(one, signal.default_int_handler)
    result = asyncio.run(play(given.seed, given.faults, given.limit, given.only, loopback=given.loopback))
    if given.json:
        shown = {"good": result.good, **vars(result)}
        sys.stdout.write(json.dumps(shown) + "\n")
    else:
        sys.stdout.write(report(result) + "\n")
    return 0 if result.good else 1


if __name__ == "__main__":
    raise SystemExit(main())
