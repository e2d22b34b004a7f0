"""The whole system from one command: a cell, proxies, lookup services, a host, and the supervisor on top.

Everything is a process of its own, as on a real network, and everything ends with the demo (`processes.py`).
"""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import Collection
from contextlib import chdir
from enum import Enum
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from robotree.files import own_folder
from robotree.tui import exit_codes
from robotree.tui.errors import DemoRuns, MemberFailed
from robotree.tui.processes.crew import Crew
from robotree.tui.processes.realm import chosen
from robotree.tui.terminal import aside, complain, note, put
from robotree.tui.wire.security import NOTHING, REALM, key_file
from robotree.vr.base.address import ROLES

if TYPE_CHECKING:
    from robotree.vr.supervision.fleet import Fleet

ARM, ROVER, VIEW = "arm-1", "rover-1", "cell"
LOOKUPS = ("lookup-1", "lookup-2")
HOST = "host-1"
FAREWELL = "The demo ends with this screen: its robots, its lookup services and its host end, too."


class Wire(Enum):
    """What joins the demo's controllers to their proxies and views."""

    TCP = "tcp"
    CAN_FD = "can fd"
    CAN_CLASSIC = "classic can"

    @classmethod
    def of(cls, *, can: bool, classic: bool) -> Wire:
        """Return the wire that the options name; classic is a kind of CAN."""
        return cls.CAN_CLASSIC if classic else cls.CAN_FD if can else cls.TCP

    def addresses(self, realm: str) -> tuple[str, str]:
        """Where the arm's and the rover's controllers listen; on CAN, two nodes of one bus of the realm.

        The channel is never a number alone, for that would be a port.
        """
        if self is Wire.TCP:
            return "tcp:127.0.0.1:0", "tcp:127.0.0.1:0"
        bus = f"can:robotree/demo-{realm}?fd={int(self is Wire.CAN_FD)}"
        return f"{bus}&node=1", f"{bus}&node=2"


class Story(Protocol):
    """What a demo consists of."""

    names: Collection[tuple[str, str]]
    """Role and name of all who take part."""

    async def cast(self, crew: Crew, *, wire: Wire, speedup: str) -> None:
        """Bring up everybody."""
        ...

    async def open(self, fleet: Fleet) -> str:
        """Build what a person finds on the screen, and return their next step, in one sentence."""
        ...

    async def accompany(self, fleet: Fleet) -> None:
        """Do what nobody does at the screen, until it is left."""
        ...

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:
        """Play without a person; the last line is one JSON object."""
        ...


async def demo(
    story: Story,
    *,
    headless: bool,
    realm: str = "",
    pictures: str = "",
    wire: Wire = Wire.TCP,
    speedup: str = "1",
    readonly: bool = False,
    key: str = REALM,
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

    Returns:
        The exit code.
    """
    realm = realm or (f"demo-{os.getpid()}" if headless else chosen(""))
    folder = Path(pictures or "robotree-demo")
    try:
        if headless:
            await asyncio.to_thread(own_folder, folder)
        await _alone(realm, story.names)
        file = await asyncio.to_thread(key_file, key, realm)
        async with Crew(realm, key=str(file or NOTHING)) as crew:
            note(f"starting the demo in realm {realm!r}: {len(story.names)} programs …")
            await story.cast(crew, wire=wire, speedup=speedup)
            if headless:
                return await story.play(realm, folder, readonly=readonly)
            return await _supervise(story, realm, readonly=readonly)
    except (MemberFailed, DemoRuns) as failure:
        complain(failure)
        return exit_codes.REFUSED
    except asyncio.CancelledError:
        note("the demo was ended from outside")
        return exit_codes.INTERRUPTED


async def _alone(realm: str, cast: Collection[tuple[str, str]]) -> None:
    """See that nobody in the realm has a name of the cast.

    Raises:
        DemoRuns: somebody has.
    """
    from robotree.client.joining import joined
    from robotree.tui.processes.realm import anybody_met

    if not anybody_met(realm):
        return
    async with joined(realm) as fleet:
        there = [one for role in ROLES for one in fleet.directory.present(role)]
        taken = sorted(one.name for one in there if (one.role, one.name) in cast)
    if taken:
        raise DemoRuns(realm, taken)


async def cast(crew: Crew, *, wire: Wire = Wire.TCP, speedup: str = "1") -> None:
    """Bring up the demo's agents, each as soon as what it needs is there.

    Args:
        crew: which they join.
        wire: between controllers and proxies.
        speedup: seconds of the simulated world in a second.

    Raises:
        MemberFailed: one did not come up.
    """
    at_arm, at_rover = wire.addresses(crew.realm)
    arm, rover, *_ = await crew.start_all(
        ("sim", "arm", "--listen", at_arm, "--state", "none", "--speedup", speedup),
        ("sim", "rover", "--listen", at_rover, "--state", "none", "--speedup", speedup),
        *(("lookup", name) for name in LOOKUPS),
        ("host", HOST),
    )
    await crew.start_all(
        ("proxy", "arm", ARM, "--connect", arm.address),
        ("proxy", "rover", ROVER, "--connect", rover.address),
        ("view", VIEW, "--connect", arm.address),
    )


class Cell:
    """An arm at its lever, and a rover."""

    names: Collection[tuple[str, str]] = (
        ("robot", ARM),
        ("robot", ROVER),
        ("view", VIEW),
        ("host", HOST),
        *(("lookup", name) for name in LOOKUPS),
    )

    async def cast(self, crew: Crew, *, wire: Wire, speedup: str) -> None:
        """Bring up the cell."""
        await cast(crew, wire=wire, speedup=speedup)

    async def open(self, fleet: Fleet) -> str:
        """Build nothing: here a person begins."""
        del fleet
        return f"next: n makes a virtual robot from a page, e puts it on top of {ARM}; ? shows all keys"

    async def accompany(self, fleet: Fleet) -> None:
        """Do nothing."""

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:
        """Play the lever's story."""
        return await _play(realm, folder, readonly=readonly)


CELL = Cell()


async def _supervise(story: Story, realm: str, *, readonly: bool) -> int:
    from robotree.client.joining import joined
    from robotree.tui.screen.supervise import supervise

    async with joined(realm) as fleet:
        hint = "" if readonly else await story.open(fleet)
        beside = asyncio.create_task(story.accompany(fleet))
        try:
            return await supervise(fleet, realm, farewell=FAREWELL, hint=hint, readonly=readonly)
        finally:
            beside.cancel()
            await asyncio.gather(beside, return_exceptions=True)


async def _play(realm: str, folder: Path, *, readonly: bool) -> int:
    """Play the lever's story and print, as the last line, what came of it as one JSON object."""
    from robotree.client.joining import joined
    from robotree.tui.session.playing import Player, read_file
    from robotree.tui.session.script import transcript

    began = time.monotonic()
    with as_file(files("robotree.examples")) as examples, chdir(folder):  # the script's pictures go there
        path = str(examples / "close_lever.session")
        script = await asyncio.to_thread(read_file, path, readonly=readonly)
        async with joined(realm) as fleet:
            report = await Player(fleet, script, lambda told: aside(transcript(told))).play()
            readings = (await fleet.describe_view(VIEW)).readings
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
    put(json.dumps(verdict))
    return exit_codes.DONE if ok else exit_codes.REFUSED
