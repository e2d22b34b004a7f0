"""What tests of the full screen need, over a realm in memory and over real processes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from typing import Any

from textual._context import visible_screen_stack
from textual.app import App
from textual.pilot import Pilot
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import ContentSwitcher, OptionList

from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.field_row import FieldRow
from tests.waiting import PATIENCE


def shows(text: str, words: Iterable[str]) -> bool:
    """Whether all words are on a screen; it is read once, for reading costs more than looking."""
    return all(word in text for word in words)


def text_of(app: App[Any]) -> str:
    """Return what is on the screen, without colours."""
    visible_screen_stack.set(app._background_screens)  # what a dialog leaves free is the page behind it
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in strips)


async def press(pilot: Pilot[int], *keys: str) -> None:
    """Press keys, each when the one before it has been dealt with and what it opened takes keys.

    Raises:
        AssertionError: that took longer than `PATIENCE`.
    """
    app: Supervisor = pilot.app  # type: ignore[assignment] # all our tests operate this one
    for key in keys:
        front = app.screen
        await app._press_keys([key])
        await at_rest(app, front)
    await pilot._wait_for_screen()


async def at_rest(app: Supervisor, before: Screen[Any] | None = None) -> None:
    """Wait until all that a person did has been dealt with, and what is in front takes keys.

    Args:
        app: the full screen.
        before: what was in front before; None: it does not matter.

    Raises:
        AssertionError: that took longer than `PATIENCE`.
    """
    taken = asyncio.Event()
    if not app.call_later(taken.set):  # it comes after all that was sent to the app before
        return
    await _until(app, taken.is_set, "a key is taken")
    await _until(app, lambda: not app.keys_wait and _takes_keys(app), "a key is dealt with")
    if not over(app) and before not in {None, app.screen}:
        drawn = asyncio.Event()
        if app.screen.call_after_refresh(drawn.set):
            front = app.screen
            await _until(app, lambda: drawn.is_set() or app.screen is not front, "a page is laid out")
            await _until(app, lambda: not app.keys_wait and _takes_keys(app), "a page is filled in")


async def _until(app: Supervisor, holds: Callable[[], bool], what: str) -> None:
    loop = asyncio.get_running_loop()
    latest = loop.time() + PATIENCE
    while not over(app) and not holds():
        assert loop.time() < latest, f"in vain: {what}:\n{text_of(app)}"
        await asyncio.sleep(0.001)


def over(app: Supervisor) -> bool:
    """Whether nothing is dealt with any more: it was left, or has failed."""
    return not app.is_running or app._exit or app._exception is not None or not app.screen_stack


def _takes_keys(app: Supervisor) -> bool:
    """Whether what is in front is there with all that is in it, and its form is the one that was chosen."""
    screen = app.screen
    if any(worker.group == "rebuild" and not worker.is_finished for worker in app.workers):
        return False
    if not all(node.is_mounted for node in screen.walk_children(with_self=True)):
        return False
    if isinstance(screen, PanelPage) and screen.robot.commands:
        chosen = screen.query_one("#commands", OptionList).highlighted
        return chosen is None or screen.query_one("#forms", ContentSwitcher).current == f"command-{chosen}"
    return True


def row(form: Widget, name: str) -> FieldRow:
    """Return the row of a field in a form, or in a page with one form."""
    return next(row for row in form.query(FieldRow) if row.spec.name == name)
