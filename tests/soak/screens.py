"""What a full screen shows while processes hang and wake, and while robots are deleted on a busy machine."""

from __future__ import annotations

import asyncio
import random
import time
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import asynccontextmanager

from textual.pilot import Pilot

from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.cached_text import CachedText
from tests.screen import text_of
from tests.soak.stage import ARM, ROOT, Stage, suspended
from tests.soak.stops import loaded
from tests.soak.table import Row, Trial

DELETED = 12
LOOPS = 8
"""Busy loops beside the deletion."""
SEEN = Row(
    "screen",
    "an open panel over an arm whose proxy is stopped: `late` or `HANGS`, never `gone`",
    "from SIGSTOP until it is drawn",
    1.5,
)
BACK = Row(
    "screen",
    "the same panel and the list after the proxy was woken: as before",
    "from SIGCONT until it is drawn",
    3.0,
)
LEFT = Row(
    "screen",
    f"{DELETED} robots deleted beside {LOOPS} busy loops: none is left in the list or called dead",
    "from the last deletion until the list is without them",
    5.0,
)


@asynccontextmanager
async def screen(stage: Stage) -> AsyncGenerator[tuple[Supervisor, Pilot[int]]]:
    """Open the full screen over the realm client of the stage."""
    app = Supervisor(stage.realm_client, realm=stage.realm)
    async with app.run_test(size=(120, 40)) as pilot:
        await drawn(pilot, lambda: ARM in app.store.descriptions, 10.0)
        yield app, pilot
        app.exit(0)


async def drawn(pilot: Pilot[int], holds: Callable[[], bool], within: float) -> float | None:
    """Wait until something holds; returns how long that took [s], None: it did not."""
    began = time.monotonic()
    while not holds():
        if time.monotonic() > began + within:
            return None
        await pilot.pause(0.02)
    return time.monotonic() - began


async def hang_and_wake(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Stop and wake the proxy of an arm under an open panel."""
    await stage.furnish()
    pid = stage.pid("arm proxy")
    async with screen(stage) as (app, pilot):
        await app.push_screen(PanelPage(app.store.descriptions[ARM]))
        page = app.screen
        assert isinstance(page, PanelPage)

        def state() -> str:
            return str(page.query_one("#who", CachedText).render())

        calm = await drawn(pilot, lambda: ARM in state() and "free" in state(), 10.0)
        told = len(app.store.entries)
        with suspended(pid):
            took = await drawn(pilot, lambda: "late" in state() or "HANGS" in state(), 10.0)
            await pilot.pause(chance.uniform(0.0, 4.0))
            hung, lines = state(), [entry.text for entry in list(app.store.entries)[told:]]
        back = await drawn(pilot, lambda: "free" in state(), 10.0)
        app.pop_screen()
        listed = await drawn(pilot, lambda: ARM in text_of(app) and "HANGS" not in text_of(app), 5.0)
        lines += [entry.text for entry in list(app.store.entries)[told:] if entry.text not in lines]
        shown = text_of(app)
    false = [f"the panel: {hung}"] if "gone" in hung.lower() else []
    false += [f"the log: {line}" for line in lines if "gone" in line or "died" in line]
    false += ["the list: GONE"] if "GONE" in shown else []
    seen = Trial(SEEN, calm is not None and took is not None, took, false)
    healed = Trial(BACK, back is not None and listed is not None, back)
    seen.note = "" if seen.reached else f"shown: {hung}"
    healed.note = "" if healed.reached else f"shown: {shown}"
    return [seen, healed]


async def delete_loaded(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Delete many robots at once on a busy machine, under an open screen."""
    await stage.furnish()
    names = [f"brief-{number}" for number in range(DELETED)]
    async with screen(stage) as (app, pilot):
        await asyncio.gather(
            *(stage.realm_client.create(str(ROOT / "examples/move_to.py"), name) for name in names)
        )
        known = await drawn(pilot, lambda: set(names) <= app.store.descriptions.keys(), 20.0)
        async with loaded(LOOPS):
            await asyncio.gather(*map(stage.realm_client.delete, names))
            took = await drawn(pilot, lambda: app.store.known.isdisjoint(names), 15.0)
        rest = sorted(app.store.known.intersection(names))
        dead = [
            entry.text
            for entry in app.store.entries
            if entry.robot in names and ("gone" in entry.text or "hangs" in entry.text)
        ]
    trial = Trial(LEFT, known is not None and took is not None, took, dead)
    trial.note = f"left in the list: {', '.join(rest)}" if rest else ""
    return [trial]
