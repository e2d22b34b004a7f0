"""Other operators hear which page is in front, and the readings have room for their list in each terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from textual.widgets import OptionList

from robotree.tui.screen.app import words_of
from robotree.tui.screen.pages.readings import ReadingsPage
from robotree.tui.screen.widgets.cached_text import CachedText

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_the_others_hear_which_part_of_the_list_is_in_front(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        told = [words_of(operator.app.screen)]
        for key in ("F", "v", "g", "l"):
            await operator.press(key)
            told.append(words_of(operator.app.screen))
        assert told == ["the list", "the plan", "the views", "the log", "the list"]


@pytest.mark.parametrize("size", [(40, 12), (80, 24)])
async def test_the_readings_have_rows_and_an_alarm_is_whole_in_a_small_terminal(
    realm: Realm, operate: Operate, place: Path, monkeypatch: pytest.MonkeyPatch, size: tuple[int, int]
) -> None:
    monkeypatch.setattr(realm.realm_client, "realm", "alarms")
    monkeypatch.setenv("XDG_STATE_HOME", str(place))
    async with operate(realm.realm_client, size=size) as operator:
        await operator.until(lambda: operator.app.store.state("arm-1") is not None)
        operator.app.choose("arm-1")
        await operator.press("U")
        page = await operator.at(ReadingsPage)
        await operator.obey("alarm below arm-1.fz 0")
        await operator.until(lambda: bool(operator.app.store.watched.open()), "the alarm")
        choices, alarms = page.query_one(OptionList), page.query_one("#readings-alarms", CachedText)
        await operator.until(lambda: alarms.display and alarms.size.height > 0, "its line")
        assert choices.scrollable_content_region.height >= 2, operator.text
        assert alarms.size.height <= size[1] // 6
        await operator.sees("raised arm-1.fz < 0 N")
