"""In a terminal that can, a picture is drawn in pixels: by placeholders of kitty, or by sixels."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from robotree.tui.processes.terminal_graphics import PictureAbility
from robotree.tui.screen.widgets.views_pane import PointedPicture
from robotree.tui.seen.graphics import PLACEHOLDER

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


@pytest.mark.parametrize(
    ("able", "sequence"),
    [
        (PictureAbility("kitty"), r"\x1b_Ga=T,U=1,q=2"),
        (PictureAbility("sixel", (8, 16)), r"\x1b7\x1b\[\d+;\d+H\x1bP0;1;0q"),
    ],
    ids=["kitty", "sixel"],
)
async def test_a_picture_is_sent_in_pixels(
    able: PictureAbility, sequence: str, realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with operate(realm.realm_client) as operator:
        operator.app.pictures = able
        sent: list[str] = []
        assert operator.app.driver is not None
        monkeypatch.setattr(operator.app.driver, "write", sent.append)
        await operator.press("v")
        picture = operator.one(PointedPicture, "#pointed")
        await operator.until(lambda: picture.frames > 0, "a picture")
        await operator.until(lambda: any(re.search(sequence, each) for each in sent), "its pixels")
        shown = sum(line.count(PLACEHOLDER) for line in operator.text.splitlines())
        assert shown == (picture.field.area if able.graphics == "kitty" else 0)
