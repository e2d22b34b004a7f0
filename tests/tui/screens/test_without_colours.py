"""With NO_COLOR nothing is told by a colour alone: what must be seen first is reversed, states have signs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from rich.segment import Segment

from robotree.tui.screen.widgets.robot_table import RobotTable

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


def drawn(operator: Operator) -> list[list[Segment]]:
    """Return the lines as the terminal gets them: through all filters."""
    app = operator.app
    ground = app.screen.background_colors[1]
    lines: list[list[Segment]] = []
    for strip in app.screen._compositor.render_strips():
        for line_filter in app.get_line_filters():
            strip = strip.apply_filter(line_filter, ground)  # noqa: PLW2901 # one after the other
        lines.append(list(strip))
    return lines


def reversed_text(operator: Operator) -> str:
    """Return what is drawn in reverse."""
    return "\n".join(
        "".join(one.text for one in line if one.style and one.style.reverse) for line in drawn(operator)
    )


async def test_without_colours_the_stop_and_the_selected_robot_are_reversed(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "rover-1" in operator.app.store.descriptions, "it is known")
        operator.app.choose("rover-1")
        await operator.until(lambda: operator.one(RobotTable).selected == "rover-1", "the cursor")
        await operator.sees("● free", "space STOP")
        assert "space STOP" in reversed_text(operator)
        await operator.until(lambda: "rover-1" in reversed_text(operator), "the cursor is seen")
        await operator.press("space")
        await operator.sees("■ PROTECTIVE STOP: arm-1, rover-1", "■ stopped")
        assert "■ PROTECTIVE STOP: arm-1, rover-1" in reversed_text(operator)
        colours = {
            colour
            for line in drawn(operator)
            for one in line
            if one.style
            for colour in (one.style.color, one.style.bgcolor)
            if colour is not None and not colour.is_default
        }
        assert {colour.get_truecolor().red for colour in colours} == {
            colour.get_truecolor().green for colour in colours
        }, "only greys"
