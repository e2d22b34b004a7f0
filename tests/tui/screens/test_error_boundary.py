"""No mistake in the supervisor ends it while robots move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from robotree.tui.exit_codes import DONE, REFUSED
from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.supervise import CRASHES, supervise
from robotree.tui.seen.store import Store

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


async def test_an_error_in_a_handler_or_a_verb_is_told_and_the_screen_goes_on(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trips(*_: object) -> None:
        raise RuntimeError("a mistake [/x]")

    async def trips_below(*_: object) -> None:
        raise KeyError("a mistake in the client")

    async with operate(realm.realm_client, mended=True) as operator:
        await operator.sees("● free")
        monkeypatch.setattr(MainPage, "action_verb", trips)
        await operator.press("n")
        await operator.sees("something went wrong in here, not in the robots: RuntimeError('a mistake [/x]')")
        monkeypatch.undo()
        await operator.press("S")
        await operator.sees("robots with problems first")
        assert len(operator.app.errors) == 1
        monkeypatch.setattr(realm.realm_client, "cancel", trips_below)
        await operator.obey("cancel arm-1")
        await operator.sees("something went wrong in here", "a mistake in the client")
        assert len(operator.app.errors) == 2


async def test_an_error_at_every_drawing_is_told_once(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trips(*_: object) -> None:
        raise ZeroDivisionError("at every drawing")

    async with operate(realm.realm_client, mended=True) as operator:
        await operator.sees("● free")
        monkeypatch.setattr(Store, "attend", trips)
        await operator.until(lambda: len(operator.app.errors) > 3, "several drawings")
        monkeypatch.undo()
        assert sum("at every drawing" in entry.text for entry in operator.app.store.entries) == 1
        await operator.press("space")
        await operator.sees("PROTECTIVE STOP")


async def test_a_dialog_stands_in_the_middle_over_its_page(operator: Operator) -> None:
    await operator.sees("● free")
    await operator.obey("delete arm-1")
    dialog = await operator.at(Confirm)
    box = dialog.query_one(".dialog").region
    assert abs(2 * box.x + box.width - 120) <= 1
    assert abs(2 * box.y + box.height - 34) <= 1
    await operator.sees("arm-1  ", "delete arm-1?")


class Headless:
    """Runs screens without a terminal; each one ends as it is told to."""

    def __init__(self, *ends: Exception | int) -> None:
        self.ends = list(ends)
        self.seen: list[str] = []

    async def run(self, app: Supervisor, **_: Any) -> int | None:
        end = self.ends.pop(0)
        self.seen = [entry.text for entry in app.store.entries]
        if isinstance(end, Exception):
            app.fatal = end
            return None
        return end


async def test_a_screen_that_ends_by_an_error_is_opened_anew_and_says_so(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    headless = Headless(RuntimeError("while it was drawn"), 0)
    monkeypatch.setattr(Supervisor, "run_async", lambda app, **_: headless.run(app))
    assert await supervise(realm.realm_client, "test") == DONE
    assert headless.seen == ["the screen had to be opened anew: RuntimeError('while it was drawn')"]


async def test_a_screen_that_ends_again_and_again_gives_up_in_one_sentence(
    realm: Realm, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    headless = Headless(*[RuntimeError("again")] * CRASHES)
    monkeypatch.setattr(Supervisor, "run_async", lambda app, **_: headless.run(app))
    assert await supervise(realm.realm_client, "test") == REFUSED
    assert "use the command line" in capsys.readouterr().err
