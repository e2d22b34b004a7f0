"""Readings over time and messages of a wire: ticked, drawn, looked back at; alarms."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated

import pytest
from textual.widgets import OptionList

from robotree.tui.processes.layout import LayoutFile
from robotree.tui.processes.wire_watch import WireMessage
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.messages import MessagesPage
from robotree.tui.screen.pages.readings import Plot, ReadingsPage
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.vr import Robot, Stream, Unit

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


class Press(Robot):
    """Presses, and says how hard to who listens."""

    force = Stream(Annotated[float, Unit("N")])
    words = Stream(str)


async def on_readings(operator: Operator) -> ReadingsPage:
    await operator.until(lambda: operator.app.store.state("arm-1") is not None)
    operator.app.choose("arm-1")
    await operator.press("U")
    return await operator.at(ReadingsPage)


async def test_a_ticked_reading_is_drawn_kept_and_looked_back_at(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    file = tmp_path / "screen.yaml"
    async with operate(realm.realm_client, size=(140, 40), layout=LayoutFile(file)) as operator:
        page = await on_readings(operator)
        await operator.sees("□ arm-1.fx", "Nothing is ticked yet. ⏎ ticks a reading")
        await operator.press("E")
        await operator.sees("tick two readings first")
        await operator.press("enter")
        await operator.until(lambda: any("⠀" < sign <= "⣿" for sign in operator.text), "the curve")
        assert LayoutFile(file).layout.ticked == {"test": ["arm-1.fx"]}
        await operator.press("down", "enter")
        await operator.until(lambda: sum(plot.display for plot in page.query(Plot)) == 2, "two plots")
        await operator.press("Z")
        assert "frozen" in page.title_of_page()
        await operator.press("left", "right", "right", "right", "right")
        assert "frozen" not in page.title_of_page(), "after the present the plots go on"
        await operator.press("minus")
        assert page.window == 10.0
        await operator.press("E")
        await operator.until(
            lambda: sum(plot.display for plot in page.query(Plot)) == 1, "one against the other"
        )
        await operator.sees("against arm-1.fx, from")
        await operator.press("E", "escape")
        await operator.at(MainPage)
    async with operate(realm.realm_client, size=(140, 40), layout=LayoutFile(file)) as operator:
        page = await on_readings(operator)
        await operator.sees("■ arm-1.fx", "■ arm-1.fy")
        await operator.press("home", "enter")
        assert LayoutFile(file).layout.ticked == {"test": ["arm-1.fy"]}
        assert operator.app.store.watched.ticked.names() == ["arm-1.fy"]


async def test_a_threshold_rings_is_in_row_log_and_header_and_a_person_acknowledges_it(
    realm: Realm, operate: Operate, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(realm.realm_client, "realm", "alarms")
    monkeypatch.setenv("XDG_STATE_HOME", str(place))
    async with operate(realm.realm_client, size=(140, 40)) as operator:
        rung: list[int] = []
        monkeypatch.setattr(operator.app, "bell", lambda: rung.append(1))
        page = await on_readings(operator)
        await operator.press("j")
        await operator.sees("alarm above arm-1.fx")
        await operator.type("nothing")
        await operator.press("enter")
        await operator.sees("'nothing' is no limit; write a number in N")
        await operator.obey("alarm below arm-1.fz 0")
        await operator.sees("ALARM: arm-1.fz was -20.0 N, < 0 N", "1 alarm: U", "raised")
        await operator.until(lambda: rung == [1], "the bell")
        await operator.press("escape")
        await operator.sees("free ▲ fz < 0 N")
        await operator.press("U")
        page = await operator.at(ReadingsPage)
        await operator.press("k")
        await operator.sees("acknowledged: arm-1.fz", "acknowledged")
        await operator.until(lambda: "1 alarm: U" not in operator.text, "the header is calm")
        await operator.press("k")
        await operator.sees("no alarm waits to be acknowledged")
        assert page.is_active
    async with operate(realm.realm_client, size=(140, 40)) as operator:
        await operator.until(lambda: "arm-1.fz" in operator.app.store.watched.alarms, "it is kept")
        assert operator.app.store.watched.alarms["arm-1.fz"].state == "acknowledged"
        await operator.obey("alarm clear arm-1.fz")
        await operator.until(lambda: not operator.app.store.watched.alarms, "it is taken away")
        await operator.obey("alarm clear arm-1.fz")
        await operator.sees("arm-1.fz has no alarm")


async def test_a_number_in_a_stream_is_ticked_heard_while_it_is_and_again_after_a_restart(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    file, press = tmp_path / "screen.yaml", Press("press-1")
    await realm.robot(press)
    for ticked in (False, True):
        async with operate(realm.realm_client, size=(140, 40), layout=LayoutFile(file)) as operator:
            await operator.until(lambda: "press-1" in operator.app.store.descriptions)
            operator.app.choose("press-1")
            await operator.press("U")
            await operator.at(ReadingsPage)
            await operator.sees(f"{'■' if ticked else '□'} press-1.stream/force")
            assert "words" not in operator.text, "words are no numbers"
            if not ticked:
                assert not press.force.wanted, "nobody listens to what is not ticked"
                await operator.press("enter")
            await operator.until(lambda: press.force.wanted, "somebody listens")
            press.force.send(12.5)
            await operator.sees("press-1.stream/force  12.5 N")
            await operator.press("j")
            await operator.sees("a stream is heard only while it is ticked")
    async with operate(realm.realm_client, size=(140, 40), layout=LayoutFile(file)) as operator:
        await operator.until(lambda: press.force.wanted, "somebody listens, whatever page is in front")
        operator.app.watching.tick(("press-1", "stream/force"))
        await operator.until(lambda: not press.force.wanted, "nobody listens any more")


TOLD = (
    WireMessage(1, 1, "GOAL_STATUS", 7, 10.0, 0.1, {"progress": 0.25, "name": "x", "args": [1.0, 2.0]}),
    WireMessage(1, 1, "HEARTBEAT", 3, 1.0, 0.4, {"type": 27}),
)


async def test_a_field_is_ticked_and_its_plot_is_a_key_away(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with operate(realm.realm_client, size=(120, 34)) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        operator.app.choose("arm-1")
        watch = SimpleNamespace(messages=TOLD, note="")
        watching = operator.app.watching
        monkeypatch.setattr(watching, "watch_wire", lambda robot: watching.wires.setdefault(robot, watch))
        await operator.press("Q")
        await operator.at(MessagesPage)
        await operator.sees(
            "1/1 GOAL_STATUS", "10.0/s", "0.1 s", "□ args[0]  1", "□ progress  0.25", "name  x"
        )
        await operator.press("enter", "end", "enter")
        await operator.sees("name is no number")
        await operator.press("home", "enter")
        await operator.sees("■ progress")
        watching._heard_wire("arm-1", TOLD)
        await operator.press("U")
        await operator.at(ReadingsPage)
        await operator.sees("■ arm-1.GOAL_STATUS.progress  0.25")
        await operator.press("escape")
        await operator.at(MessagesPage)
        monkeypatch.setattr(watching, "leave_wire", watching.wires.pop)
        await operator.press("escape")
        await operator.at(MainPage)


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
