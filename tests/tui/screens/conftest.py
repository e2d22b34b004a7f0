"""An operator at the keyboard of the full screen, over a realm in memory."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Sized
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import pytest
from textual._compositor import Compositor
from textual._xterm_parser import XTermParser
from textual.css.model import RuleSet
from textual.css.stylesheet import Stylesheet
from textual.events import Event
from textual.pilot import Pilot
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Button, Input

from robotree.tui.processes.layout import LayoutFile
from robotree.tui.screen import key_guard
from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.keymap import Keymap
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.user_app import UserApp
from robotree.tui.screen.widgets import log_pane
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.tui.seen import feeding
from robotree.tui.seen.selection import Place
from robotree.vr.agents import publisher, shared
from tests.screen import at_rest, over, press, shows, text_of
from tests.waiting import PATIENCE

if TYPE_CHECKING:
    from tui.conftest import Realm

    from robotree.vr.supervision.realm_client import RealmClient

KEYS = {
    " ": "space", ".": "full_stop", "_": "underscore", "-": "minus", ":": "colon", "/": "slash",
    "=": "equals_sign", "[": "left_square_bracket", "]": "right_square_bracket", ",": "comma",
}  # fmt: skip

LOOK_AGAIN = 0.03
"""[s] between two looks at the screen; Textual's own pause would ask each widget whether it is idle."""

W = TypeVar("W", bound=Widget)
S = TypeVar("S", bound="Screen[object]")


class Operator:
    """Presses keys and looks at the screen."""

    def __init__(self, app: Supervisor, pilot: Pilot[int]) -> None:
        self.app, self._pilot = app, pilot

    async def press(self, *keys: str) -> None:
        """Press keys, each when the one before it has been dealt with and what it opened takes keys."""
        await press(self._pilot, *keys)

    async def type(self, text: str) -> None:
        await self.press(*(KEYS.get(letter, letter) for letter in text))

    def burst(self, bytes_: str, *, at: float | None = None) -> None:
        """Send at once, as a terminal does when it was kept waiting; nothing is waited for.

        Args:
            bytes_: what the terminal sends.
            at: [s] on the app's clock, when it was typed; None: now.
        """
        for event in XTermParser().feed(bytes_):
            assert isinstance(event, Event)
            event.time = event.time if at is None else at
            if self.app.admits(event):
                self.app.post_message(event.set_sender(self.app))

    async def click(self, selector: str) -> None:
        """Click on a widget that is there and laid out, and wait until that has been dealt with."""
        front = self.app.screen
        await at_rest(self.app)
        await self._pilot.click(selector)
        await at_rest(self.app, front)

    async def resize(self, width: int, height: int) -> None:
        await self._pilot.resize_terminal(width, height)

    async def obey(self, text: str) -> None:
        """Type a verb at the prompt."""
        await self.press("colon")
        self.one(Input, "#line").value = text
        await self.press("enter")

    async def until(self, holds: Callable[[], bool], what: str = "it", within: float = PATIENCE) -> None:
        """Wait until something holds."""
        try:
            async with asyncio.timeout(within):
                while not holds():  # noqa: ASYNC110 # the screen has no event for every change
                    await asyncio.sleep(LOOK_AGAIN)
        except TimeoutError:
            pytest.fail(f"{what} did not come about:\n{self.text}")

    async def settled(self) -> None:
        """Wait until all that was sent to widgets has been dealt with and drawn."""
        await self._pilot.pause()

    async def sees(self, *words: str) -> None:
        """Wait until all words are on the screen."""
        await self.until(lambda: shows(self.text, words), str(words))

    async def hears(self, *words: str) -> None:
        """Wait until an event has all these words: pages but the main one show the newest event only."""
        await self.until(
            lambda: any(shows(entry.text, words) for entry in self.app.store.entries), f"the event {words}"
        )

    async def at(self, kind: type[S]) -> S:
        """Wait until a page of this kind is in front and laid out: earlier keys may not be meant for it."""
        await self.until(lambda: isinstance(self.app.screen, kind), kind.__name__)
        there = asyncio.Event()
        self.app.screen.call_after_refresh(there.set)
        await self.until(lambda: there.is_set() or not isinstance(self.app.screen, kind), "its layout")
        assert isinstance(self.app.screen, kind)
        await self.settled()
        assert self.text
        return self.app.screen

    async def panel(self, name: str = "arm-1") -> PanelPage:
        """Open the panel of a robot that has said how it is; its first form is there."""
        store = self.app.store
        await self.until(lambda: name in store.descriptions and store.state(name) is not None, name)
        await self.until(lambda: name != "arm-1" or "x" in store.readings(name), "its readings")
        self.app.ask_for("panel", Place(name))
        page = await self.at(PanelPage)
        await self.until(lambda: bool(page.query(CommandForm)) and bool(page.query(Button)), "the form")
        return page

    async def select(self, name: str) -> RobotTable:
        """Move the cursor of the list to a robot."""
        await self.until(lambda: name in self.app.store.known | self.app.store.groups.keys(), name)
        table = self.one(RobotTable)
        await self.until(lambda: name in table.names, f"{name} listed")
        await self.press("home")
        while table.selected != name:
            await self.press("down")
        return table

    def one(self, kind: type[W], selector: str = "") -> W:
        return self.app.screen.query_one(selector, kind) if selector else self.app.screen.query_one(kind)

    @property
    def text(self) -> str:
        """What is on the screen, without colours."""
        return text_of(self.app)


Operate = Callable[..., AbstractAsyncContextManager[Operator]]


async def settle(_least: float = 0.0, most: float = PATIENCE) -> None:
    """Return when nothing is left to do but to wait for time, threads or keys.

    In place of Textual's own, which looks every 20 ms whether the process computes.
    """
    loop = asyncio.get_running_loop()
    ready: Sized = loop._ready  # type: ignore[attr-defined] # of asyncio's own loops
    end, idle = loop.time() + most, 0
    while idle < 2 and loop.time() < end:
        await asyncio.sleep(0)
        idle = 0 if ready else idle + 1


@pytest.fixture(autouse=True)
def prompt(monkeypatch: pytest.MonkeyPatch) -> None:
    """Press the next key as soon as the one before has been taken: Textual waits 40 ms for each."""
    monkeypatch.setattr("textual.app.wait_for_idle", settle)
    monkeypatch.setattr("textual.pilot.wait_for_idle", settle)


_parsed: dict[tuple[object, ...], list[RuleSet]] = {}
_parse = Stylesheet._parse_rules


def parse_once(sheet: Stylesheet, *source: Any, **more: Any) -> list[RuleSet]:
    """Return the rules of a source; every app would parse the same ones again."""
    key = (*source, *more.items(), *sheet._variables.items())
    if key not in _parsed:
        _parsed[key] = _parse(sheet, *source, **more)
    return _parsed[key]


@pytest.fixture(autouse=True)
def parsed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parse each style sheet once in a process."""
    monkeypatch.setattr(Stylesheet, "_parse_rules", parse_once)


_render_update = Compositor.render_update


def draw_nothing(
    compositor: Compositor,
    full: bool = False,  # noqa: FBT001, FBT002 # as Textual calls it
    screen_stack: list[Screen[object]] | None = None,
) -> None:
    """Take what is to be drawn for drawn."""
    del full, screen_stack
    compositor._dirty_regions.clear()


@pytest.fixture(autouse=True)
def drawn_when_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw a page where a test looks at it, when it has come to the front, and at the end; no frame between.

    Without a terminal Textual throws each frame away. They were a quarter of the processor time.
    """
    monkeypatch.setattr(Compositor, "render_update", draw_nothing)


@pytest.fixture
def every_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw each frame, for a test that asks what is drawn, or when: autouse fixtures come first."""
    monkeypatch.setattr(Compositor, "render_update", _render_update)


@pytest.fixture(autouse=True)
def own_state(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Begin without what another test has chosen: a language, a theme, a page."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))


@pytest.fixture(autouse=True)
def calm(monkeypatch: pytest.MonkeyPatch) -> None:
    """No animations: they only cost time."""
    monkeypatch.setattr("textual.constants.TEXTUAL_ANIMATIONS", "none")


@pytest.fixture(autouse=True)
def in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have no key overtake the one before it because the machine is busy."""
    monkeypatch.setattr(key_guard, "LIMIT", PATIENCE)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """See at once what comes unasked and as long as it takes; hear soon how robots are."""
    monkeypatch.setattr(log_pane, "STAYS", PATIENCE)
    monkeypatch.setattr(key_guard, "LOOK", 0.0)
    monkeypatch.setattr(feeding, "PAUSE", 0.05)
    monkeypatch.setattr(publisher, "QUICK", 0.03)
    monkeypatch.setattr(shared, "ROUND", 0.15)


@pytest.fixture
def operate() -> Operate:
    """Return how to sit down before a realm client; at the end nothing may have been mended."""

    @asynccontextmanager
    async def sit_down(
        realm_client: RealmClient,
        *,
        size: tuple[int, int] = (120, 34),
        mended: bool = False,
        farewell: str = "",
        readonly: bool = False,
        keymap: Keymap | None = None,
        calm: bool = False,
        kind: type[Supervisor] = Supervisor,
        layout: LayoutFile | None = None,
    ) -> AsyncGenerator[Operator]:
        app = kind(
            realm_client,
            realm="test",
            farewell=farewell,
            readonly=readonly,
            keymap=keymap,
            calm=calm,
            layout=layout,
        )
        async with app.run_test(size=size) as pilot:
            operator = Operator(app, pilot)
            await operator.until(
                lambda: (app.store.joined or kind is UserApp) and len(app.screen_stack) > 1, "the main page"
            )
            yield operator
            if not over(app):
                await operator.settled()  # nobody leaves a page that is still being made
            assert app.fatal is not None or operator.text
        assert app.fatal is None
        assert mended or app.errors == []

    return sit_down


@pytest.fixture
async def operator(realm: Realm, operate: Operate) -> AsyncGenerator[Operator]:
    """Sit down before the usual realm, on a usual screen."""
    async with operate(realm.realm_client) as found:
        yield found
