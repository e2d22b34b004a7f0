"""The demo of the composer: a cup is carried once by hand, and again by the page that was made of that.

The arm is led in steps, as a person leads it with the keys of tele-operation; what it did is read from its
history. The page made of that is tried in a twin of the cell, carries the cup, and carries it again from
another place: one parameter is changed. Whether the cup is where it should be, the hand feels there.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from robotree.tui.composing.demonstration import composed
from robotree.tui.composing.gathering import gathered
from robotree.tui.composing.steps import ComposedCall, walk
from robotree.tui.composing.writing import KnownRobots, Prepared, Tried, prepared, tried, write
from robotree.tui.demo import ARM, CELL, Course, Tell
from robotree.tui.errors import BadComposition
from robotree.tui.line.past import settled_events
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.supervision.realm_client import RealmClient

NAME, HOST = "cup", "host-1"
HERE, THERE, BESIDE = (0.30, -0.20), (0.30, -0.30), (0.30, -0.25)
"""[m] x and y on the table: where the cup stands, where it is carried, and from where it is carried again."""
LOW, HIGH = 0.03, 0.15
"""[m] of the gripper above the table: where it grips, and where it travels."""
STRIDE: Final = 0.05
"""[m] of one step by hand: the third of the steps that the tele-operation has."""
LONGEST: Final = 120.0
"""[s] that one command may take."""
LINES: Final = 40
"""Lines that the page may have."""


class ComposeVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the demo."""

    ok: bool
    lines: int
    shown: int
    """Commands that were given by hand."""
    steps: int
    """Commands that the page gives."""
    tried: bool
    """Whether the page went well in the twin."""
    moved: bool
    """Whether the page has carried the cup to where it was shown."""
    moved_again: bool
    """The same from another place, with one parameter changed."""
    trouble: str
    wall_s: float


class Compose(Course):
    """The cell, and an arm that is led by hand."""

    file, goals = CELL.file, None

    async def open(self, realm_client: RealmClient) -> str:
        """Build nothing: here a person begins."""
        del realm_client
        return f"next: C composes, and T there has you lead {ARM} to the cup by hand; ? shows all keys"

    async def accompany(self, realm_client: RealmClient, tell: Tell) -> None:
        """Do nothing."""

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:
        """Play without a person; the page is written into the folder."""
        self._folder = folder
        return await super().play(realm, folder, readonly=readonly)

    async def course(self, realm_client: RealmClient, tell: Tell, *, alone: bool) -> ComposeVerdict:  # noqa: ARG002 # it has no other
        """Carry the cup by hand, then by the page."""
        return await _Course(realm_client, self._folder, tell).run()

    def summary(self, verdict: ComposeVerdict) -> str:
        """Say what came of it."""
        return verdict.trouble


class _Course:
    def __init__(self, realm_client: RealmClient, folder: Path, tell: Tell) -> None:
        self._client, self._folder, self._tell = realm_client, folder, tell
        self._shown = 0
        self._ready: Prepared | None = None
        self._tried: Tried | None = None
        self._moved: list[bool] = []

    async def run(self) -> ComposeVerdict:
        began, trouble = time.monotonic(), ""
        try:
            await self._play()
        except (VrError, BadComposition, OSError) as error:
            trouble = str(error)
            self._tell(trouble, "error")
        lines = self._ready.lines if self._ready else 0
        went = self._tried is not None and self._tried.ok
        moved, again = (*self._moved, False, False)[:2]
        made = self._ready.checked.composition if self._ready else None
        return ComposeVerdict(
            ok=went and moved and again and 0 < lines <= LINES and not trouble,
            lines=lines,
            shown=self._shown,
            steps=sum(isinstance(step, ComposedCall) for _, step in walk(made.steps if made else ())),
            tried=went,
            moved=moved,
            moved_again=again,
            trouble=trouble,
            wall_s=round(time.monotonic() - began, 2),
        )

    async def _play(self) -> None:
        self._tell(f"{ARM} is led by hand: it carries the cup once")
        await self._show()
        ready, tried_so = self._ready, self._tried
        if ready is None or tried_so is None:
            return
        self._tell(f"{ready.page}: {ready.lines} lines; {tried_so.told}")
        for place, changed in ((HERE, {}), (BESIDE, {"from_y": BESIDE[1]})):
            self._tell(f"the cup is put to {place} by hand")
            await self._carry(THERE, place)
            call = " ".join([f"{NAME}.{ready.checked.composition.command}", *map(_given, changed.items())])
            self._tell(f"call {call}")
            await self._let_page(ready, changed)
            self._moved.append(await self._is_at(THERE))
            self._tell(f"the cup is {'there' if self._moved[-1] else 'not there'}")

    # -- by hand -----------------------------------------------------------------------------------

    async def _show(self) -> None:
        """Carry the cup by hand in small steps, and make a page of that."""
        before, since = await self._client.describe(ARM), time.time()
        await self._carry(HERE, THERE)
        events = await settled_events(self._client, ARM, since)
        found = gathered(events, {ARM: before}, (ARM,), {ARM: before.readings})
        self._shown = len(found.shown)
        made = composed(NAME, found.robots, found.shown, starts=found.starts)
        origin = "Made by `robotree demo compose`."
        self._ready = await asyncio.to_thread(prepared, made, KnownRobots.of(), origin)
        self._tried = await asyncio.to_thread(tried, self._ready)
        await asyncio.to_thread(write, self._ready, self._folder, replace=True)

    async def _carry(self, origin: tuple[float, float], goal: tuple[float, float]) -> None:
        await self._lead(*origin, HIGH)
        await self._lead(*origin, LOW)
        await self._call("grip", action="close")
        await self._lead(*origin, HIGH)
        await self._lead(*goal, HIGH)
        await self._lead(*goal, LOW)
        await self._call("grip", action="open")
        await self._lead(*goal, HIGH)

    async def _lead(self, x: float, y: float, z: float) -> None:
        """Lead the arm in steps along one axis after the other: a hand on the keys does it so."""
        here = await self._info()
        pose = {axis: float(here[axis]) for axis in ("x", "y", "z")}
        for axis, goal in (("x", x), ("y", y), ("z", z)):
            count = math.ceil(abs(goal - pose[axis]) / STRIDE - 1e-3)
            start = pose[axis]
            for step in range(1, count + 1):
                pose[axis] = start + (goal - start) * step / count
                await self._call("go_to", **pose, twist=0.0)

    async def _is_at(self, place: tuple[float, float]) -> bool:
        """Feel whether the cup stands at a place."""
        for z in (HIGH, LOW):
            await self._call("go_to", x=place[0], y=place[1], z=z, twist=0.0)
        await self._call("grip", action="close")
        holds = bool((await self._info())["holding"])
        await self._call("grip", action="open")
        await self._call("go_to", x=place[0], y=place[1], z=HIGH, twist=0.0)
        return holds

    async def _info(self) -> Mapping[str, Any]:
        found: Mapping[str, Any] = await self._client.call(ARM, "get_info", {}, deadline=LONGEST)
        return found

    async def _call(self, command: str, **arguments: Any) -> None:
        await self._client.call(ARM, command, arguments, deadline=LONGEST)

    # -- by its page -------------------------------------------------------------------------------

    async def _let_page(self, ready: Prepared, changed: Mapping[str, float]) -> None:
        """Put the robot of the page on the arm, have it carry the cup, and let the arm go again."""
        await self._client.create(str(self._folder / ready.page), NAME, HOST)
        try:
            await self._client.enslave(NAME, "arm", ARM)
            command = ready.checked.composition.command
            await self._client.call(NAME, command, dict(changed), deadline=LONGEST)
        finally:
            await self._client.delete(NAME)


def _given(pair: tuple[str, float]) -> str:
    return f"{pair[0]}={pair[1]}"
