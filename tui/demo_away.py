"""`robotree demo away`: a rover is switched off, three orders wait for it, and each is carried out once.

A rover registers with two directories. One user takes it along. It is switched off; the other user leaves
two orders, and the first one a third where there is no network, which goes to the directories at the next
contact.
The realm is stopped and released. The rover comes back, is killed once in the middle, and each order has its
result. What its controller began is read from the controller's own log.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from robotree.client.joining import joined
from robotree.tui.demo import (
    beside_the_screen,
    kept_apart,
    leaving_nothing,
    own_realm,
    said,
    to_its_end,
    until,
)
from robotree.tui.demo_crash import begun_in
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import Crew, Member
from robotree.tui.processes.state_files import NOWHERE
from robotree.tui.terminal import aside, note
from robotree.tui.wire.security import NOTHING, REALM, key_file

if TYPE_CHECKING:
    from robotree.vr.base.order import Order
    from robotree.vr.supervision.realm_client import RealmClient

ROVER, DEVICE = "rover-1", "notebook"
MOVES = ("x=0.6 y=0", "x=0 y=0.4", "x=-0.4 y=0")
"""The orders: the last one is left without a network."""
LONGEST = 90.0
"""[s] for the rover to carry all out."""
LOOKS = 0.05
"""[s] between two looks."""
SEEN = 30.0
"""[s] for the directories to know the rover."""


class AwayVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """The result of the demo."""

    ok: bool
    orders_away: int
    """Orders that were left while the rover was away, and have their result."""
    twice: int
    """Motions that the controller began more than once."""
    doubts: int
    kills: int
    held: bool
    """Whether the stop held the rover while it was away."""
    states: list[str]
    """Of the orders, in the order in which they were left."""
    on_line_s: float
    """[s] from the moment that the rover was back to the last result."""
    wall_s: float


class _Stage:
    """The processes of the demo, and its two users."""

    def __init__(self, crew: Crew, realm: str, folder: Path, state: Path | None, key: str) -> None:
        self.crew, self.realm, self.folder = crew, realm, folder
        self.goals = folder / "goals"
        self._own = {"ROBOTREE_REALM": realm, "ROBOTREE_KEY": key}
        self._state = {"XDG_STATE_HOME": str(state)} if state else {}
        self._device = {"XDG_STATE_HOME": str(folder / DEVICE)}
        self._apart = {"XDG_RUNTIME_DIR": str(folder / "no-network")}
        (folder / "no-network").mkdir(mode=0o700)

    async def say(self, words: str, *, device: bool = False, network: bool = True) -> Any:
        """Run a line of a user, and return its plain data.

        Raises:
            MemberFailed: it was refused.
        """
        more: Mapping[str, str] = {
            **self._own,
            **(self._device if device else self._state),
            **({} if network else self._apart),
        }
        aside(f"{'the notebook' if device else 'anna'}: robotree {words}")
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *("-m", "robotree.tui", *words.split(), "--json"),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, **more},
        )
        out, err = await process.communicate()
        if process.returncode:
            raise MemberFailed(words.split(), f"ended with code {process.returncode}", (err + out).decode())
        return json.loads(out)

    async def proxy(self, address: str) -> Member:
        """Switch the rover on."""
        return await self.crew.start("proxy", "rover", ROVER, "--connect", address)

    async def switch_off(self, proxy: Member) -> None:
        """Switch the rover off."""
        self.crew.members.remove(proxy)
        await proxy.stop()


@to_its_end
async def away(*, headless: bool, realm: str = "", readonly: bool = False, key: str = REALM) -> int:
    """Play the demo; without `headless` beside the full screen.

    Args:
        headless: without a person; the last line is one JSON object.
        realm: where; empty: for a person that of the environment or the default one, else one of its own.
        readonly: whether the screen leaves out all that changes robots.
        key: of all links: a file, `realm` for the realm's own key, or `none`.

    Returns:
        The exit code.
    """
    realm = realm or own_realm(headless=headless)
    with (
        leaving_nothing(realm),
        kept_apart(realm) as state,
        tempfile.TemporaryDirectory(prefix="robotree-demo-") as folder,
    ):
        file = await asyncio.to_thread(key_file, key, realm)
        key = str(file or NOTHING)
        async with Crew(realm, key=key, state=state, restarts=True) as crew:
            note(f"starting the demo in realm {realm!r}: a rover, its proxy, two directories …")
            stage = _Stage(crew, realm, Path(folder), state, key)
            if headless:
                return said(await _play(stage))
            async with joined(realm) as realm_client:
                return await beside_the_screen(
                    realm_client,
                    lambda _client, _tell: _play(stage),
                    farewell="The demo ends with this screen.",
                    hint="the rover is switched off soon, and orders wait for it: A shows them",
                    readonly=readonly,
                    restarts=crew.starts_again,
                )


async def _play(stage: _Stage) -> AwayVerdict:
    began = time.monotonic()
    words = ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", NOWHERE, "--log", str(stage.goals))
    sim, *_ = await stage.crew.start_all(words, ("directory", "directory-1"), ("directory", "directory-2"))
    proxy = await stage.proxy(sim.address)
    async with joined(stage.realm) as realm_client:
        await until(lambda: _is_known(realm_client), SEEN, LOOKS)
        await stage.say(f"take {ROVER} --as {DEVICE}", device=True)
        await stage.switch_off(proxy)
        aside(f"{ROVER} is switched off")
        for move in MOVES[:-1]:
            await stage.say(f"call {ROVER}.move {move} --queue --until 1h")
        await stage.say(f"call {ROVER}.move {MOVES[-1]} --queue --until 1h", device=True, network=False)
        await stage.say("orders", device=True)  # its next contact
        await stage.say("stop")
        held = bool((await realm_client.orders.board()).holds)
        await stage.say("resume")
        await stage.proxy(sim.address)
        back = time.monotonic()
        aside(f"{ROVER} is back")
        await _kill_in_the_middle(stage)
        await until(lambda: _are_over(realm_client), LONGEST, LOOKS)
        on_line = time.monotonic() - back
        orders = await _orders(realm_client)
    return _verdict(stage, orders, held=held, on_line=on_line, wall=time.monotonic() - began)


def _verdict(
    stage: _Stage, orders: Sequence[Order], *, held: bool, on_line: float, wall: float
) -> AwayVerdict:
    begun = Counter(goal.key for goal in begun_in(stage.goals))
    twice = sum(count - 1 for count in begun.values()) + max(0, len(begun) - len(orders))
    doubts = sum(each.state == "doubt" for each in orders)
    over = sum(each.over for each in orders)
    ok = over == len(MOVES) == len(orders) and not twice and not doubts and held
    ok = ok and len({each.who for each in orders}) == 2  # two users
    for each in orders:
        aside(f"order {each.ticket} of {each.who}: {each.shown} {each.why}")
    return AwayVerdict(
        ok=ok,
        orders_away=over,
        twice=twice,
        doubts=doubts,
        kills=1,
        held=held,
        states=[each.shown for each in orders],
        on_line_s=round(on_line, 2),
        wall_s=round(wall, 2),
    )


async def _kill_in_the_middle(stage: _Stage) -> None:
    """Kill the rover's process once while it carries an order out; the crew starts it again."""
    end = time.monotonic() + LONGEST
    while time.monotonic() < end and not begun_in(stage.goals):  # noqa: ASYNC110 # a file
        await asyncio.sleep(LOOKS)
    proxy = next(each for each in stage.crew.members if each.words[:1] == ("proxy",))
    os.kill(proxy.pid, signal.SIGKILL)
    aside(f"{ROVER} (process {proxy.pid}) is killed by kill -9 in the middle; the demo starts it again")


async def _is_known(realm_client: RealmClient) -> bool:
    known = await realm_client.orders.robot(ROVER)
    return known is not None and len(realm_client.orders.directories) == 2  # both


async def _orders(realm_client: RealmClient) -> Sequence[Order]:
    return (await realm_client.orders.board()).orders


async def _are_over(realm_client: RealmClient) -> bool:
    orders = await _orders(realm_client)
    return len(orders) >= len(MOVES) and all(each.over for each in orders)
