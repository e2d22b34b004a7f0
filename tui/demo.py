"""The whole system from one command: a cell, proxies, lookup services, a host, and the supervisor on top.

Everything is a process of its own, as on a real network, and everything ends with the demo (`processes.py`).
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import time
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Coroutine, Generator, Mapping, Sequence
from contextlib import chdir, contextmanager, nullcontext, suppress
from enum import Enum
from functools import wraps
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, Protocol

from msgspec import structs, to_builtins

from robotree.client.joining import joined
from robotree.files import own_folder
from robotree.tui import exit_codes
from robotree.tui.errors import DemoRuns, MemberFailed
from robotree.tui.processes.crew import Crew
from robotree.tui.processes.realm import anybody_met, chosen
from robotree.tui.processes.state_files import DEMOS, state_file
from robotree.tui.realm_file.applying import Done, bring_about
from robotree.tui.realm_file.content import NAMELESS, ProcessEntry, RealmFile
from robotree.tui.realm_file.pages import pages_of
from robotree.tui.realm_file.plan import Plan
from robotree.tui.realm_file.present import ROLES, Controller
from robotree.tui.realm_file.verbs import read_realm_file
from robotree.tui.terminal import aside, complain, note, put
from robotree.tui.wire.security import NOTHING, REALM, key_file
from robotree.vr.base.errors import VrError
from robotree.vr.base.written import Word
from robotree.vr.network.realms import inhabited, realm_folder

if TYPE_CHECKING:
    from robotree.tui.seen.store import Weight
    from robotree.vr.supervision.realm_client import RealmClient

ARM, ROVER, VIEW = "arm-1", "rover-1", "cell"
HOST, MOVER, LEVER = "host-1", "mover", "lever"
OPENING = 4.0
"""[s] for a person to see the cell before it begins."""
EXAMPLES = Path(str(files("robotree.examples")))
FAREWELL = "The demo ends with this screen: its robots, its lookup services and its host end, too."


Given = ParamSpec("Given")


class Wire(Enum):
    """The link between the demo's controllers and their proxies and views."""

    TCP = "tcp"
    CAN_FD = "can fd"
    CAN_CLASSIC = "classic can"

    @classmethod
    def of(cls, *, can: bool, classic: bool) -> Wire:
        """Return the wire that the options name; classic is a kind of CAN."""
        return cls.CAN_CLASSIC if classic else cls.CAN_FD if can else cls.TCP

    def address(self, realm: str, number: int) -> str:
        """Where a controller listens: on CAN, the node of this number on one bus of the realm.

        The channel is never a number alone, for that would be a port.
        """
        if self is Wire.TCP:
            return "tcp:127.0.0.1:0"
        return f"can:robotree/demo-{realm}?fd={int(self is Wire.CAN_FD)}&node={number}"


class Tell(Protocol):
    """Takes a line for the log of the screen."""

    def __call__(self, text: str, weight: Weight = "plain") -> object:
        """Take it, and how much it matters."""
        ...


class Story(Protocol):
    """The parts of a demo."""

    @property
    def goals(self) -> Path | None:
        """Folder of the files into which controllers write their goals, by name; None: they do not."""
        ...

    @property
    def file(self) -> Path:
        """The realm file with all who take part."""
        ...

    async def open(self, realm_client: RealmClient) -> str:
        """Build what a person finds on the screen, and return their next step, in one sentence."""
        ...

    async def accompany(self, realm_client: RealmClient, tell: Tell) -> None:
        """Do what nobody does at the screen, until it is left."""
        ...

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:
        """Play without a person; the last line is one JSON object."""
        ...


# -- the frame of every demo --------------------------------------------------------------------------


def to_its_end(course: Callable[Given, Awaitable[int]]) -> Callable[Given, Coroutine[Any, Any, int]]:
    """Say why a demo has ended, where it has not come to its own end; it returns the exit code then."""

    @wraps(course)
    async def played(*given: Given.args, **named: Given.kwargs) -> int:
        try:
            return await course(*given, **named)
        except (MemberFailed, DemoRuns) as failure:
            complain(failure)
            return exit_codes.REFUSED
        except asyncio.CancelledError:
            note("the demo was ended from outside")
            return exit_codes.INTERRUPTED

    return played


async def until(holds: Callable[[], Awaitable[object]], within: float, every: float = 0.1) -> bool:
    """Ask until something holds; an agent that does not answer is asked again.

    Args:
        holds: asks.
        within: [s] at most.
        every: [s] between two questions.

    Returns:
        Whether it holds.
    """
    latest = time.monotonic() + within
    while True:
        with suppress(VrError):
            if await holds():
                return True
        if time.monotonic() > latest:
            return False
        await asyncio.sleep(every)


def own_realm(*, headless: bool) -> str:
    """Return the realm of a demo that names none: a person has to find it, and nobody shares a script's."""
    return f"demo-{os.getpid()}" if headless else chosen("")


@contextmanager
def leaving_nothing(realm: str) -> Generator[None]:
    """Remove the realm of a script's demo behind it, with its key: nobody else has been told its name."""
    try:
        yield
    finally:
        folder = realm_folder(realm)
        if realm == own_realm(headless=True) and not inhabited(folder):
            shutil.rmtree(folder, ignore_errors=True)


def said(verdict: object) -> int:
    """Print what came of a demo, as the last line and one JSON object; return the exit code.

    Args:
        verdict: plain data or a struct; its `ok` says whether all went well.
    """
    data = to_builtins(verdict)
    put(json.dumps(data))
    return exit_codes.DONE if data["ok"] else exit_codes.REFUSED


class Course(ABC):
    """What happens in a demo beside a screen, and without one."""

    async def open(self, realm_client: RealmClient) -> str:
        """Build what a person finds on the screen, and return their next step, in one sentence."""
        return await build_lever(realm_client)

    @abstractmethod
    async def course(self, realm_client: RealmClient, tell: Tell, *, alone: bool) -> Any:
        """Play the story, and return the verdict; `alone`: nobody is at a screen."""

    @abstractmethod
    def summary(self, verdict: Any) -> str:
        """Say what came of it, in a sentence for the log of the screen."""

    async def accompany(self, realm_client: RealmClient, tell: Tell) -> None:
        """Play the story beside the screen, and say how it ended."""
        await asyncio.sleep(OPENING)
        verdict = await self.course(realm_client, tell, alone=False)
        tell(self.summary(verdict), "good" if verdict.ok else "error")

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:  # noqa: ARG002  a fixed course
        """Play without a person; the last line is one JSON object."""

        def tell(text: str, weight: Weight = "plain") -> None:
            del weight
            aside(text)

        async with joined(realm) as realm_client:
            await self.open(realm_client)
            return said(await self.course(realm_client, tell, alone=True))


async def build_lever(realm_client: RealmClient) -> str:
    """Put a robot that moves smoothly on the arm, and one that knows the lever on that."""
    for page, name in (("move_to.py", MOVER), ("open_close_lever.py", LEVER)):
        await realm_client.create(str(EXAMPLES / page), name, HOST)
    await realm_client.enslave(MOVER, "arm", ARM)
    await realm_client.enslave(LEVER, "mover", MOVER)
    return ""


async def beside_the_screen(
    realm_client: RealmClient,
    accompany: Callable[[RealmClient, Tell], Coroutine[Any, Any, Any]],
    *,
    hint: str,
    farewell: str = FAREWELL,
    readonly: bool = False,
    restarts: Callable[[str], bool] = lambda _: True,
) -> int:
    """Show the full screen, and let something happen beside it until it is left; returns the exit code.

    `restarts` says of a name whether the demo starts that process again.
    """
    from robotree.tui.screen.supervise import supervise
    from robotree.tui.seen.store import Store

    store, realm = Store(restarter="the demo", restarts=restarts), realm_client.realm

    def tell(text: str, weight: Weight = "plain") -> None:
        store.tell(text, weight, time.monotonic())

    beside = asyncio.create_task(accompany(realm_client, tell))
    try:
        return await supervise(
            realm_client, realm, farewell=farewell, hint=hint, readonly=readonly, store=store
        )
    finally:
        beside.cancel()
        await asyncio.gather(beside, return_exceptions=True)


# -- the demos in one realm ----------------------------------------------------------------------------


@to_its_end
async def demo(  # noqa: PLR0913 # one for each option of the line
    story: Story,
    *,
    headless: bool,
    realm: str = "",
    pictures: str = "",
    wire: Wire = Wire.TCP,
    speedup: str = "1",
    readonly: bool = False,
    key: str = REALM,
    apart: bool = True,
) -> int:
    """Start everything, hand over to a person or to the story's own course, and end everything.

    Args:
        story: which.
        headless: play the story instead of showing the supervisor.
        realm: where; empty: for a person that of the environment or the default one, so that a second
            terminal sees the demo, and for the script a realm of its own.
        pictures: folder for pictures; empty: `robotree-demo` in the current one.
        wire: between controllers and proxies.
        speedup: seconds of the simulated world in a second.
        readonly: whether the screen leaves out all that changes robots.
        key: of all links: a file, `realm` for the realm's own key, or `none`.
        apart: whether what its processes keep goes with the demo; False: it lies where the realm's does.

    Returns:
        The exit code.
    """
    realm = realm or own_realm(headless=headless)
    folder = Path(pictures or "robotree-demo")
    if headless:
        await asyncio.to_thread(own_folder, folder)
    wanted = await asyncio.to_thread(read_realm_file, str(story.file))
    await _alone(realm, wanted)
    with leaving_nothing(realm), kept_apart(realm) if apart else nullcontext() as state:
        file = await asyncio.to_thread(key_file, key, realm)
        async with Crew(realm, key=str(file or NOTHING), state=state, restarts=True) as crew:
            note(f"starting the demo in realm {realm!r}: {len(wanted.processes)} programs …")
            await cast(crew, wire=wire, speedup=speedup, file=story.file, goals=story.goals)
            if headless:
                return await story.play(realm, folder, readonly=readonly)
            return await _supervise(story, realm, crew.starts_again, readonly=readonly)


@contextmanager
def kept_apart(realm: str) -> Generator[Path | None]:
    """Give a folder for what the processes of a demo keep, which goes with it: each demo begins anew.

    Yields:
        The folder; None: it cannot be made.
    """
    folder = state_file(DEMOS, realm)
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)  # of one that was killed
    try:
        yield folder
    finally:
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
            with suppress(OSError):  # there is another demo
                folder.parent.rmdir()


async def _alone(realm: str, wanted: RealmFile) -> None:
    """See that nobody in the realm has a name of the file.

    Raises:
        DemoRuns: somebody has.
    """
    if not anybody_met(realm):
        return
    names = {(ROLES[process.verb], process.name) for process in wanted.processes if process.verb != NAMELESS}
    names |= {("robot", robot.name) for robot in wanted.robots}
    async with joined(realm) as realm_client:
        there = [one for role in set(ROLES.values()) for one in realm_client.directory.present(role)]
        taken = sorted(one.name for one in there if (one.role, one.name) in names)
    if taken:
        raise DemoRuns(realm, taken)


async def cast(
    crew: Crew,
    *,
    wire: Wire = Wire.TCP,
    speedup: str = "1",
    file: Path | None = None,
    goals: Path | None = None,
) -> None:
    """Bring up what a realm file says, as `robotree apply` does, with processes of a crew.

    Args:
        crew: which they join.
        wire: between controllers and proxies.
        speedup: seconds of the simulated world in a second.
        file: which; None: the demo's cell.
        goals: see `Story.goals`.

    Raises:
        MemberFailed: a step could not be done.
    """
    wanted = await asyncio.to_thread(read_realm_file, str(file or CELL.file))
    wanted = adapted(wanted, crew.realm, wire, speedup, goals)
    pages = await asyncio.to_thread(pages_of, wanted)
    failed: list[Done] = []

    def report(done: Done) -> None:
        if done.outcome == "failed":
            failed.append(done)

    async def agree(_: Plan) -> None:
        pass

    async with joined(crew.realm) as realm_client:
        await bring_about(wanted, pages, realm_client, CrewStarter(crew), report, agree)
    for done in failed[:1]:
        raise MemberFailed(done.step.text.split(), "failed", done.reason)


def adapted(wanted: RealmFile, realm: str, wire: Wire, speedup: str, goals: Path | None = None) -> RealmFile:
    """Return a file whose simulated controllers are on another wire, at another speed, and write goals."""
    controllers = [process.name for process in wanted.processes if process.verb == NAMELESS]

    def other(entry: ProcessEntry) -> ProcessEntry:
        if entry.verb != NAMELESS:
            return entry
        address = wire.address(realm, 1 + controllers.index(entry.name))
        words = {"listen": address, "speedup": speedup}
        words |= {} if goals is None else {"log": str(goals / entry.name)}
        facets = {name: Word(text, entry.mark) for name, text in words.items()}
        return structs.replace(entry, facets=entry.facets | facets)

    return structs.replace(wanted, processes=tuple(map(other, wanted.processes)))


class CrewStarter:
    """Starts the processes of a realm file as members of a crew: they end with it."""

    def __init__(self, crew: Crew) -> None:
        """Begin without controllers."""
        self._crew = crew
        self.controllers: dict[str, Controller] = {}

    async def start(self, entry: ProcessEntry, words: Sequence[str], environment: Mapping[str, str]) -> str:
        """See `Starter`; the crew's key is that of all links."""
        del environment
        member = await self._crew.start(*words)
        if entry.verb == NAMELESS:
            self.controllers[entry.name] = Controller(member.pid, member.address)
        return member.address


class Cell:
    """An arm at its lever, and a rover."""

    file, goals = EXAMPLES / "cell.realm.yaml", None

    async def open(self, realm_client: RealmClient) -> str:
        """Build nothing: here a person begins."""
        del realm_client
        return f"next: n makes a virtual robot from a page, e puts it on top of {ARM}; ? shows all keys"

    async def accompany(self, realm_client: RealmClient, tell: Tell) -> None:
        """Do nothing."""

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:
        """Play the lever's story."""
        return await _play(realm, folder, readonly=readonly)


CELL = Cell()


async def _supervise(story: Story, realm: str, restarts: Callable[[str], bool], *, readonly: bool) -> int:
    async with joined(realm) as realm_client:
        hint = "" if readonly else await story.open(realm_client)
        return await beside_the_screen(
            realm_client, story.accompany, hint=hint, readonly=readonly, restarts=restarts
        )


async def _play(realm: str, folder: Path, *, readonly: bool) -> int:
    """Play the lever's story and print, as the last line, what came of it as one JSON object."""
    from robotree.tui.session.playing import Player, read_file
    from robotree.tui.session.script import transcript

    began = time.monotonic()
    with chdir(folder):  # the script's pictures go there
        path = str(EXAMPLES / "close_lever.session")
        script = await asyncio.to_thread(read_file, path, readonly=readonly)
        async with joined(realm) as realm_client:
            report = await Player(realm_client, script, lambda step: aside(transcript(step))).play()
            readings = (await realm_client.describe_view(VIEW)).readings
    angle, force = readings.get("lever"), readings.get("peak_force")
    ok = report.ok and angle is not None and force is not None
    verdict = {
        "ok": ok,
        "lever_angle_rad": angle,
        "peak_force_n": force,
        "wall_s": round(time.monotonic() - began, 2),
        "steps": len(report.told),
        "not_played": len(report.left),
        "pictures": [str(folder / name) for name in ("before.jpg", "after.jpg") if (folder / name).exists()],
    }
    return said(verdict)
