"""The demo of several machines: two sites and their hubs, each in its own folders, and a slow line between.

The site `plant` has the arm and its lever; the robots that close the lever live at the site `desk`, where the
person sits. The hub that carries everything between the two is killed while the lever closes. The sites go on
by the next hub of their list, what was under way is repeated, and the lever closes; the first hub is started
again meanwhile.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import tempfile
import time
from collections.abc import Generator, Sequence
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from robotree.client.joining import joined
from robotree.tui.demo import (
    ARM,
    HOST,
    LEVER,
    MOVER,
    VIEW,
    Course,
    Tell,
    beside_the_screen,
    build_lever,
    to_its_end,
    until,
)
from robotree.tui.demo_crash import CONTROLLER, LONGEST, LOOKS, begun_in, closed, under_way
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import Crew
from robotree.tui.processes.state_files import KEYS
from robotree.tui.sites.slow_line import SlowLine
from robotree.tui.terminal import note
from robotree.tui.wire.security import NOTHING, REALM, key_file
from robotree.vr.base.errors import VrError
from robotree.vr.network.realms import state_home

if TYPE_CHECKING:
    from robotree.tui.processes.crew import Member
    from robotree.vr.sites.keys import RealmKeys
    from robotree.vr.supervision.realm_client import RealmClient

NAME = "sites"
DESK, PLANT = "desk", "plant"
DELAY, LONGEST_DELAY = 150, 300
"""[ms] One way between the sites, if nobody says otherwise, and at most: a hub is dialed within 2 s, which is
three ways there and back."""
HUBS = 2
AT = 6
"""Goals of the command that the controller has begun when the hub is killed."""
LINKED = 60.0
"""[s] for two sites to see each other on a busy machine."""
FAREWELL = "The demo ends with this screen: both sites and the hubs end, too."


class SitesVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the demo."""

    ok: bool
    delay_ms: int
    """One way between the sites."""
    join_s: float
    """For the second site, from the token to its certificate."""
    hub_kills: int
    hub_back_s: float
    """From the kill of the hub until a question that was asked then was answered by the other site."""
    twice: int
    """Steps that were taken more than once."""
    lost: int
    """Steps that were accepted and that the controller never began."""
    doubts: int
    goals: int
    """Goals that the controller has begun for the command."""
    lever_angle_rad: float | None
    peak_force_n: float | None
    stopped: Sequence[str]
    """Who confirmed the stop in the end, those of the other site with its name."""
    stop_s: float
    trouble: str
    """Why the command has not ended well; empty: it has."""
    wall_s: float


class _Place(NamedTuple):
    """The folders of a site: those that a machine of its own would have."""

    runtime: Path
    state: Path

    @property
    def environment(self) -> dict[str, str]:
        return {"XDG_RUNTIME_DIR": str(self.runtime), "XDG_STATE_HOME": str(self.state)}


@to_its_end
async def demo(
    *,
    headless: bool,
    delay: int = DELAY,
    realm: str = "",
    speedup: str = "1",
    readonly: bool = False,
    key: str = REALM,
    make: type[Sites] | None = None,
) -> int:
    """Start both sites and the hubs, hand over to a person or close the lever, and end everything.

    Args:
        headless: close the lever and print what came of it, instead of showing the supervisor of the desk.
        delay: [ms] one way between the sites.
        realm: its name; empty: `demo`.
        speedup: seconds of the simulated world in a second.
        readonly: whether the screen leaves out all that changes robots.
        key: of the links between controllers and proxies: a file, `realm`, or `none`.
        make: what becomes of them; None: the hub between them is killed.

    Returns:
        The exit code.
    """
    realm = realm or "demo"
    with places() as folders:
        async with AsyncExitStack() as stack:
            sites = (make or Sites)(folders, realm, delay, speedup, stack)
            note(f"starting two sites and two hubs of realm {realm!r}, {delay} ms apart …")
            await sites.start(await asyncio.to_thread(key_file, key, realm))
            desk = folders[DESK].environment
            line = " ".join(f"{name}={folder}" for name, folder in desk.items())
            note(f"the desk in a second terminal: {line} robotree --realm {realm} ls")
            if headless:
                return await sites.play(realm, Path(), readonly=readonly)
            return await sites.supervise(readonly=readonly)


@contextmanager
def places() -> Generator[dict[str, _Place]]:
    """Make the folders of both sites and of the hubs, and be at the desk meanwhile."""
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        found: dict[str, _Place] = {}
        for name in (DESK, PLANT, "hub"):
            place = _Place(Path(folder, name, "run"), Path(folder, name, "state"))
            for path in place:
                path.mkdir(mode=0o700, parents=True)
            found[name] = place
        before = {name: os.environ.get(name) for name in found[DESK].environment}
        os.environ.update(found[DESK].environment)
        try:
            yield found
        finally:
            for name, text in before.items():
                if text is None:
                    del os.environ[name]
                else:
                    os.environ[name] = text


class Sites(Course):
    """Both sites and their hubs."""

    story = f"{LEVER} closes its lever from here, and the hub between them is killed meanwhile"
    """What the screen says of what comes."""

    def __init__(
        self, places: dict[str, _Place], realm: str, delay: int, speedup: str, stack: AsyncExitStack
    ) -> None:
        """Prepare.

        Args:
            places: folders of the sites and of the hubs.
            realm: which both join.
            delay: [ms] of the line, one way.
            speedup: of the simulated world.
            stack: ends what is started.
        """
        self.realm, self.delay = realm, delay
        self.places, self._speedup, self._stack = places, speedup, stack
        self._hub: Member | None = None
        self.join_s = 0.0

    async def start(self, key: Path | None) -> None:
        """Start everything; both sites see each other then.

        Raises:
            MemberFailed: a process did not come up, or the sites did not find each other.
        """
        from robotree.vr.sites.invitations import Hub
        from robotree.vr.sites.joining import ask_authority
        from robotree.vr.sites.keys import create

        now, near, far = time.time(), list[Hub](), list[Hub]()
        hubs = await self._crew("hub", key)
        for member in await hubs.start_all(*(("hub", "--listen", _free_address()) for _ in range(HUBS))):
            self._hub = self._hub or member
            address, _, fingerprint = member.address.partition("#")
            line = SlowLine("127.0.0.1", int(address.rpartition(":")[2]), delay=self.delay / 1000)
            port = await line.open()
            self._stack.push_async_callback(line.close)
            near.append(Hub(address, fingerprint))
            far.append(Hub(f"tls:127.0.0.1:{port}", fingerprint))
        keys = await asyncio.to_thread(create, self._keys(DESK), self.realm, DESK, tuple(near), now=now)
        desk, plant = await self._crew(DESK, key), await self._crew(PLANT, key)
        controller = ("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--state", "none")
        options = ("--speedup", self._speedup, "--log", str(self.goals))
        starting = asyncio.gather(
            desk.start_all(("gateway",), ("lookup", "lookup-1"), ("host", HOST)),
            plant.start_all((*controller, *options), ("lookup", "lookup-2")),
        )
        _, (table, _) = await starting
        invitation = await asyncio.to_thread(keys.invite, PLANT, "site", now=now)
        there = msgspec.structs.replace(invitation, hubs=tuple(far))
        began = time.monotonic()
        try:
            await asyncio.to_thread(ask_authority, self._keys(PLANT), there, now=now)
        except VrError as error:
            raise MemberFailed(("realm", "join"), "failed", str(error)) from None
        self.join_s = time.monotonic() - began
        await plant.start_all(
            ("gateway",),
            ("proxy", "arm", ARM, "--connect", table.address),
            ("view", VIEW, "--connect", table.address),
            *await asyncio.to_thread(self.plant_hosts, keys),
        )

    def plant_hosts(self, keys: RealmKeys) -> list[tuple[str, ...]]:
        """Return the hosts that the plant has, as they are started.

        Args:
            keys: of the desk.
        """
        del keys
        return []

    async def _crew(self, name: str, key: Path | None) -> Crew:
        place = self.places[name]
        crew = Crew(
            self.realm,
            key=str(key or NOTHING),
            state=place.state,
            runtime=place.runtime,
            restarts=True,
        )
        return await self._stack.enter_async_context(crew)

    def _keys(self, site: str) -> Path:
        """Return the folder of a site's keys; that of the realm is there then."""
        folder = self.places[site].state / state_home().name / self.realm
        folder.parent.mkdir(mode=0o700, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        return folder / KEYS

    @property
    def goals(self) -> Path:
        """The file into which the controller writes the goals that it begins."""
        return self.places[PLANT].state / CONTROLLER

    # -- the course -------------------------------------------------------------------------------

    async def open(self, realm_client: RealmClient) -> str:
        """Put robots of the desk on the arm of the plant.

        Raises:
            MemberFailed: the plant is not seen.
        """
        await self.see_plant(realm_client)
        await build_lever(realm_client)
        return f"{ARM} is at site {PLANT}, {self.delay} ms away; {self.story}; ? shows all keys"

    async def see_plant(self, realm_client: RealmClient) -> None:
        """Wait until the arm and the view of the plant answer.

        Raises:
            MemberFailed: they do not.
        """

        async def answer() -> bool:
            await realm_client.describe_view(VIEW)
            return (await realm_client.describe(ARM)).online

        if not await until(answer, LINKED):
            raise MemberFailed(("gateway",), "failed", f"site {PLANT} is not seen from site {DESK}")

    async def supervise(self, *, readonly: bool) -> int:
        """Show the screen of the desk, and close the lever beside it."""
        async with joined(self.realm) as realm_client:
            if readonly:
                hint = f"{ARM} and {VIEW} are at site {PLANT}, {self.delay} ms from here"
                from robotree.tui.screen.supervise import supervise

                return await supervise(realm_client, self.realm, farewell=FAREWELL, hint=hint, readonly=True)
            hint = await self.open(realm_client)
            return await beside_the_screen(realm_client, self.accompany, hint=hint, farewell=FAREWELL)

    def summary(self, verdict: Any) -> str:
        """Say what came of it."""
        figures = f"{verdict.twice} steps twice, {verdict.lost} lost, {verdict.doubts} in doubt"
        if verdict.ok:
            return f"the lever is closed across {self.delay} ms: {figures}"
        return f"the lever is not closed as it should be: {figures}; {verdict.trouble}"

    async def course(self, realm_client: RealmClient, tell: Tell, *, alone: bool) -> Any:
        """Close the lever, kill the hub meanwhile, and say what came of it.

        Args:
            realm_client: at the desk.
            tell: takes what happens.
            alone: nobody is at a screen: all robots are stopped in the end.
        """
        began, since, before = time.monotonic(), time.time(), len(begun_in(self.goals))
        tell(f"{LEVER} closes its lever at site {PLANT}")
        call = asyncio.ensure_future(realm_client.call(LEVER, "close", {}, deadline=LONGEST))
        kills, back = list[float](), 0.0
        if await under_way(call, self.goals, before + AT):
            kills.append(time.time())
            back = await self._hub_dies(realm_client, tell)
        crash = await closed(realm_client, call, self.goals, before, since, kills)
        stopped, stop_s, trouble = list[str](), 0.0, crash.trouble
        if alone:
            ordered = time.monotonic()
            try:
                stopped = sorted(await realm_client.stop(None))
            except VrError as error:
                trouble = trouble or str(error)
            stop_s = time.monotonic() - ordered
        all_stopped = not alone or {LEVER, MOVER, f"{PLANT}:{ARM}"} <= set(stopped)
        return SitesVerdict(
            ok=crash.ok and all_stopped,
            delay_ms=self.delay,
            join_s=round(self.join_s, 2),
            hub_kills=len(kills),
            hub_back_s=round(back, 2),
            twice=crash.twice,
            lost=crash.lost,
            doubts=crash.doubts,
            goals=crash.goals,
            lever_angle_rad=crash.lever_angle_rad,
            peak_force_n=crash.peak_force_n,
            stopped=stopped,
            stop_s=round(stop_s, 2),
            trouble=trouble,
            wall_s=round(time.monotonic() - began, 2),
        )

    async def _hub_dies(self, realm_client: RealmClient, tell: Tell) -> float:
        """Kill the first hub; return when the other site answered again [s after the kill]."""
        assert self._hub is not None  # noqa: S101 # `start` has started it
        killed = time.monotonic()
        os.kill(self._hub.pid, signal.SIGKILL)
        tell(f"the hub (process {self._hub.pid}) is killed by kill -9; the demo starts it again", "warning")
        answers = await until(lambda: realm_client.describe(ARM), LINKED, LOOKS)
        took = time.monotonic() - killed
        if answers:
            tell(f"site {PLANT} answers again {took:.1f} s after the kill")
        return took


def _free_address() -> str:
    """Return an address on loopback that is free now: a hub that is started again listens where it did."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tls:127.0.0.1:{free.getsockname()[1]}"
