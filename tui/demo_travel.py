"""The demo of the right place: one arm, a slow line, and robots that are on one side of it or on the other.

The arm and its lever are at the site `plant`. A smooth move of many small steps, and the lever, are carried
out by robots that are near the operator, that are near the arm, that move there in the middle of the command,
and that are left to find their place themselves. The controller of the arm writes down each goal that it
begins, so what was taken twice or is missing is counted there. The time of the smooth move is what its own
command measures, without the way of the operator's call.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from robotree.tui.demo import ARM, EXAMPLES, HOST, LEVER, MOVER, VIEW, Tell, until
from robotree.tui.demo_crash import CLOSED, Goal, begun_in, under_way
from robotree.tui.demo_sites import DESK, PLANT, Sites
from robotree.tui.errors import MemberFailed
from robotree.tui.seen.wording import columns
from robotree.tui.terminal import aside
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.sites.keys import RealmKeys
    from robotree.vr.supervision.realm_client import RealmClient

SMOOTH, NEAR_HOST = "smooth", "host-2"
PAGES = ("smooth_move.py", "move_to.py", "open_close_lever.py")
STEPS, LENGTH = 50, 0.02
"""Of the smooth move; the length [m] is that of the whole way."""
SPEEDUP = "10"
"""Seconds of the simulated world in a second: the way to the arm is compared here, and not the arm."""
AGAIN = 3
"""How often the quick moves are made; the quickest counts."""
FASTER, AS_GOOD = 25.0, 0.9
"""What the demo is to show: how much faster near the arm, and how much of that by `auto`."""
FASTER_AT = 150
"""[ms] one way: the line for which that is promised; a shorter one gains less."""
LONGEST = 600.0
"""[s] that a command may take."""
SETTLES = 60.0
"""[s] for robots that find their place themselves to be there."""
MIDDLE = 6
"""Goals of a command after which its robots move."""
BAR = 40
"""Cells of the longest bar."""


class TravelVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the demo."""

    ok: bool
    delay_ms: int
    """One way between the sites."""
    steps: int
    faster: float
    """Time of the smooth move near the operator over that near the arm."""
    auto: float
    """Time near the arm over that of a robot which has found its place itself: 1 is as good."""
    twice: int
    """Steps that were taken more than once."""
    lost: int
    """Steps of smooth moves that the controller never began."""
    smooth_s: dict[str, float]
    """[s] of the smooth move, by where it was carried out."""
    lever_s: dict[str, float]
    """[s] of the lever, likewise, with the way of the call."""
    auto_moved_s: float
    """From its first step until it was near the arm, by itself."""
    why: str
    """Why it has moved, as it says."""
    lever_angle_rad: float | None
    peak_force_n: float | None
    trouble: str
    """Why something has not ended well; empty: all has."""
    wall_s: float


def counted(goals: Sequence[Goal], wanted: int | None = None) -> tuple[int, int]:
    """Return how many steps were taken twice, and how many are missing. Pure.

    Args:
        goals: that the controller has begun for a command.
        wanted: how many there were to be; None: not known.
    """
    keys = Counter(goal.key for goal in goals)
    twice = sum(count - 1 for count in keys.values())
    if wanted is None:
        return twice, 0
    return twice + max(len(keys) - wanted, 0), max(wanted - len(keys), 0)


def plot(times: dict[str, float], title: str) -> str:
    """Draw times [s] as bars, on a logarithmic scale from a tenth of the least to the most."""
    least = min(times.values()) / 10
    span = math.log(max(times.values()) / least)
    rows = [
        (
            f"  {name}",
            f"{seconds:.2f} s".rjust(9),
            "█" * max(1, round(BAR * math.log(seconds / least) / span)),
        )
        for name, seconds in times.items()
    ]
    return f"{title} (logarithmic)\n{columns(rows)}"


class Travel(Sites):
    """Both sites, with a host each."""

    story = "robots move it from here, from there, while they move, and from where they like it best"

    def __init__(self, *given: Any) -> None:
        """Prepare; see `Sites`."""
        super().__init__(*given)
        self._twice = self._lost = 0
        self._far = 1
        self._pages = dict[str, Path]()
        """The signed pages, by the names of their files."""

    def plant_hosts(self, keys: RealmKeys) -> list[tuple[str, ...]]:
        """Have a host that runs pages which the desk has signed, and sign those of the demo."""
        from robotree.vr.bundle import Bundle
        from robotree.vr.bundle.build import file_of, realm_key, signed
        from robotree.vr.bundle.trust import Signer
        from robotree.vr.sites.ssh import read_public

        key, trust = realm_key(keys), self.places[PLANT].state / "trusted"
        for page in PAGES:
            self._pages[page] = (self.places[DESK].state / page).with_suffix(".bundle")
            file_of(signed(Bundle.read(EXAMPLES / page), key)).write(self._pages[page])
        public = read_public(*key.public.split()[:2])
        trust.write_text(f"{Signer((DESK,), public, isolation='none').line()}\n")
        return [("host", NEAR_HOST, "--trust", str(trust))]

    async def open(self, realm_client: RealmClient) -> str:
        """Put a robot that moves in small steps on the arm.

        Raises:
            MemberFailed: the plant is not seen.
        """
        await self.see_plant(realm_client)

        async def seen() -> bool:
            return NEAR_HOST in {host.address.name for host in await realm_client.hosts()}

        if not await until(seen, SETTLES):
            raise MemberFailed(("host", NEAR_HOST), "failed", f"it is not seen from {HOST}")
        await realm_client.create(str(self._pages[PAGES[0]]), SMOOTH, HOST)
        await realm_client.enslave(SMOOTH, "arm", ARM)
        return f"{ARM} is at site {PLANT}, {self.delay} ms away; {self.story}; ? shows all keys"

    async def course(self, realm_client: RealmClient, tell: Tell, *, alone: bool) -> TravelVerdict:
        """Compare the ways, and print the table where nobody has a screen."""
        verdict = await self.compare(realm_client, tell)
        if alone:
            aside(self.table(verdict))
        return verdict

    def summary(self, verdict: TravelVerdict) -> str:
        """Say what came of it."""
        figures = f"{verdict.faster:.0f} times faster near {ARM}, {verdict.auto:.0%} of that by itself"
        return f"{figures}; {verdict.twice} steps twice; {verdict.trouble}"

    def table(self, verdict: TravelVerdict) -> str:
        """Lay out what came of it."""
        rows = [(f"{STEPS} STEPS AND LOOKS, {self.delay} ms ONE WAY", "SMOOTH MOVE", "LEVER")]
        rows += [
            (name, f"{seconds:.2f} s", f"{verdict.lever_s[name]:.2f} s" if name in verdict.lever_s else "")
            for name, seconds in verdict.smooth_s.items()
        ]
        return "\n\n".join([columns(rows), plot(verdict.smooth_s, "smooth move")])

    # -- the course -------------------------------------------------------------------------------

    async def compare(self, realm_client: RealmClient, tell: Tell) -> TravelVerdict:
        """Move the arm from everywhere, and say what came of it."""
        began, trouble = time.monotonic(), ""
        smooth, lever, moved, why = dict[str, float](), dict[str, float](), math.nan, ""
        try:
            moved, why = await self._smooth(realm_client, tell, smooth)
            await self._levers(realm_client, tell, lever)
        except VrError as error:
            trouble = str(error)
        readings: dict[str, float] = {}
        with suppress(VrError):
            readings = (await realm_client.describe_view(VIEW)).readings
        angle, force = readings.get("lever"), readings.get("peak_force")
        faster = smooth.get("near the operator", 0.0) / smooth.get("near the arm", math.inf)
        auto = smooth.get("near the arm", 0.0) / smooth.get("auto", math.inf)
        if not trouble and (angle is None or angle > -CLOSED):
            trouble = "the lever is not open in the end"
        promised = FASTER if self.delay >= FASTER_AT else 1.0
        sound = not (self._twice or self._lost or trouble)
        return TravelVerdict(
            ok=sound and faster >= promised and auto >= AS_GOOD,
            delay_ms=self.delay,
            steps=STEPS,
            faster=round(faster, 1),
            auto=round(auto, 2),
            twice=self._twice,
            lost=self._lost,
            smooth_s={name: round(seconds, 3) for name, seconds in smooth.items()},
            lever_s={name: round(seconds, 2) for name, seconds in lever.items()},
            auto_moved_s=round(moved, 1),
            why=why,
            lever_angle_rad=angle,
            peak_force_n=force,
            trouble=trouble,
            wall_s=round(time.monotonic() - began, 1),
        )

    async def _smooth(
        self, realm_client: RealmClient, tell: Tell, times: dict[str, float]
    ) -> tuple[float, str]:
        """Move smoothly from everywhere; returns after which time [s] the robot has moved itself, and why."""
        near = f"{PLANT}:{NEAR_HOST}"
        tell(f"{SMOOTH} goes {STEPS} steps near the operator, and looks after each")
        times["near the operator"] = await self._sweep(realm_client)
        tell(f"{SMOOTH} moves to {near} in the middle of the next ones")
        times["moved in between"] = await self._sweep(realm_client, moves=near)
        tell(f"{SMOOTH} goes them near the arm")
        times["near the arm"] = min([await self._sweep(realm_client) for _ in range(AGAIN)])
        await realm_client.migrate(SMOOTH, HOST)
        await realm_client.place(SMOOTH, "auto")
        tell(f"{SMOOTH} is back on {HOST}, and is left to itself")
        finding, began = asyncio.ensure_future(self._found(realm_client, SMOOTH)), time.monotonic()
        times["auto, until it is there"] = await self._sweep(realm_client)
        while not finding.done() and time.monotonic() < began + SETTLES:
            await self._sweep(realm_client)
        if not finding.done():
            finding.cancel()
            return math.nan, ""
        moved = finding.result() - began
        times["auto"] = min([await self._sweep(realm_client) for _ in range(AGAIN)])
        why = (await realm_client.describe(SMOOTH)).placed
        tell(f"{SMOOTH} has moved after {moved:.1f} s: {why}")
        await realm_client.place(SMOOTH, "manual")
        await realm_client.release(SMOOTH, "arm")
        return moved, why

    async def _sweep(self, realm_client: RealmClient, moves: str = "") -> float:
        """Move smoothly, there and back in turns; returns what the command says that it took [s]."""
        arguments = {"steps": STEPS, "length": LENGTH * self._far}
        self._far = -self._far
        movers = [SMOOTH] if moves else []
        return float(await self._counted(realm_client, SMOOTH, "sweep", arguments, movers, moves, STEPS))

    async def _counted(
        self,
        realm_client: RealmClient,
        robot: str,
        command: str,
        arguments: dict[str, Any],
        movers: Sequence[str],
        host: str,
        wanted: int | None = None,
    ) -> Any:
        """Call a command, have robots move meanwhile, and count its steps, of which `wanted` are expected."""
        before = len(begun_in(self.goals))
        call = asyncio.ensure_future(realm_client.call(robot, command, arguments, deadline=LONGEST))
        try:
            if movers:
                await under_way(call, self.goals, before + MIDDLE)
            for mover in movers:
                await realm_client.migrate(mover, host)
        except BaseException:
            call.cancel()
            raise
        result = await call
        twice, lost = counted(begun_in(self.goals)[before:], wanted)
        self._twice, self._lost = self._twice + twice, self._lost + lost
        return result

    async def _found(self, realm_client: RealmClient, robot: str) -> float:
        """Wait until a robot is near the arm; returns when that was [s]."""

        async def near() -> bool:
            return (await realm_client.describe(robot)).host.rpartition(":")[2] == NEAR_HOST

        await until(near, math.inf, 0.2)
        return time.monotonic()

    async def _levers(self, realm_client: RealmClient, tell: Tell, times: dict[str, float]) -> None:
        """Close and open the lever from everywhere."""
        for page, name in zip(PAGES[1:], (MOVER, LEVER), strict=True):
            await realm_client.create(str(self._pages[page]), name, HOST)
        await realm_client.enslave(MOVER, "arm", ARM)
        await realm_client.enslave(LEVER, "mover", MOVER)
        near = f"{PLANT}:{NEAR_HOST}"
        tell(f"{LEVER} closes its lever near the operator")
        times["near the operator"] = await self._swing(realm_client, "close")
        tell(f"{LEVER} and {MOVER} move to {near} while it opens")
        times["moved in between"] = await self._swing(realm_client, "open", moves=near)
        tell(f"{LEVER} closes it near the arm")
        times["near the arm"] = await self._swing(realm_client, "close")
        for robot in (MOVER, LEVER):
            await realm_client.migrate(robot, HOST)
            await realm_client.place(robot, "auto")
        tell(f"{LEVER} and {MOVER} are back on {HOST}, and open it, left to themselves")
        times["auto, until it is there"] = await self._swing(realm_client, "open")

    async def _swing(self, realm_client: RealmClient, command: str, moves: str = "") -> float:
        """Move the lever; returns how long that took [s]."""
        began = time.monotonic()
        await self._counted(realm_client, LEVER, command, {}, [MOVER, LEVER] if moves else [], moves)
        return time.monotonic() - began
