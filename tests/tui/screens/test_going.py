"""A robot is sent to a point: by the plan, by a picture, and after it has said what it would do."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Button, Input

from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.going import lifetime
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import Outcome
from robotree.tui.processes.place_files import NamedPlace, places_beside
from robotree.tui.processes.terminal_graphics import PictureAbility
from robotree.tui.screen.pages.going import GoDialog, NameDialog
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.plan_pane import PlanView
from robotree.tui.screen.widgets.views_pane import PointedPicture
from robotree.tui.seen.graphics import PLACEHOLDER
from robotree.tui.seen.selection import Place
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import HeldByOperator
from robotree.vr.network.policy_file import PolicyFile

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


GO = Surface(Where.SCRIPT).parse(["go", "arm-1", "x=0.3", "y=0.1", "--preview"])


async def at_plan(operator: Operator) -> PlanView:
    await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "the arm")
    operator.app.choose("arm-1")
    await operator.press("F")
    await operator.until(lambda: "arm-1" in operator.text, "the plan")
    await operator.until(lambda: "z" in operator.app.store.readings("arm-1"), "where the arm is")
    return operator.one(PlanView)


async def test_the_cursor_of_the_plan_is_where_the_robot_goes(realm: Realm, operator: Operator) -> None:
    plan = await at_plan(operator)
    await operator.press("up", "up", "left")
    point = plan.point
    assert point is not None
    await operator.press("enter")
    dialog = await operator.at(GoDialog)
    assert realm.arm.calls == [], "nothing moves before somebody says so"
    assert float(dialog.query_one("#at-x", Input).value) == round(point[0], 3)
    dialog.query_one("#yes", Button).focus()
    await operator.press("enter")
    await operator.until(lambda: realm.arm.calls == ["go_to"], "the arm goes")
    await operator.until(lambda: abs(realm.arm.pose["x"] - point[0]) < 1e-3, "it is there")


async def test_what_the_robot_has_said_of_a_point_is_kept_when_it_is_chosen(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    await at_plan(operator)
    await operator.press("up")
    foresight, places = operator.app.foresight, list[Place]()
    await operator.until(lambda: foresight.newest is not None and foresight.newest.answered, "the answer")
    monkeypatch.setattr(operator.app, "ask_for", lambda _verb, place: places.append(place))
    await operator.press("enter")
    await operator.until(lambda: places == [Place("arm-1")], "it is chosen")
    await operator.settled()
    assert foresight.newest is not None


async def test_what_somebody_else_controls_is_refused_before_anybody_says_go(
    realm: Realm, operator: Operator
) -> None:
    with sitting_at("pts/9"):
        ben = await realm.realm_client.control("arm-1", "get")
    await at_plan(operator)
    await operator.press("up")
    await operator.sees(f"{ben} has control of")
    await operator.press("enter")
    dialog = await operator.at(GoDialog)
    await operator.until(lambda: dialog.query_one("#yes", Button).disabled, "it is refused")
    with sitting_at("pts/9"):
        way = await carry_out(realm.realm_client, GO, Silent())
    assert isinstance(way, Outcome), "its holder may"
    refused = await carry_out(realm.realm_client, GO, Silent())
    assert isinstance(refused, Refusal)
    assert isinstance(refused.error, HeldByOperator)
    listed = await carry_out(realm.realm_client, Surface(Where.SCRIPT).parse(["ls"]), Silent())
    assert isinstance(listed, Outcome)
    assert {
        one["name"] if "name" in one else one["address"]["name"]: one["control"] for one in listed.data
    } == {
        "arm-1": ben,
        "rover-1": "",
    }
    assert "CONTROL" in listed.text
    assert realm.arm.calls == []


async def test_a_named_point_has_the_height_and_the_twist_of_the_tool_and_a_wrong_name_can_be_mended(
    realm: Realm, operate: Operate, tmp_path: Path
) -> None:
    realm.network.gate = gate = PolicyFile(tmp_path)
    realm.members["operator"].gate = gate
    realm.arm.pose |= {"z": 0.3, "twist": math.pi / 2}
    async with operate(realm.realm_client) as operator:
        plan = await at_plan(operator)
        await operator.until(lambda: operator.app.store.readings("arm-1")["z"] == 0.3, "where the arm is")
        await operator.press("up", "K")
        dialog = await operator.at(NameDialog)
        await operator.sees("twist 90.0°", "Its robot says no frame")
        await operator.type("top shelf")
        await operator.press("enter")
        await operator.sees("'top shelf' cannot be a name")
        assert operator.app.screen is dialog
        field = dialog.query_one(Input)
        assert field.value == "top shelf", "what was typed stays"
        field.value = "shelf"
        await operator.press("enter")
        await operator.until(lambda: "shelf" in places_beside(gate).names(), "it is kept")
        point = plan.point
        assert point is not None
        wanted = {"x": point[0], "y": point[1], "z": 0.3, "twist": math.pi / 2}
        assert places_beside(gate).find("shelf").at == pytest.approx(wanted, abs=1e-3)


async def test_places_say_of_which_controller_they_are_and_which_of_them_lead_nowhere(
    realm: Realm, tmp_path: Path
) -> None:
    realm.network.gate = gate = PolicyFile(tmp_path)
    realm.members["operator"].gate = gate
    assert "means something until the controller listens somewhere else" in lifetime("tcp:127.0.0.1:40067")
    at = {"x": 0.3, "y": 0.1}
    places_beside(gate).write(NamedPlace(name="old", frame="tcp:127.0.0.1:36685", at=at))
    places_beside(gate).write(NamedPlace(name="shelf", frame="", at=at))
    listed = await carry_out(realm.realm_client, Surface(Where.SCRIPT).parse(["places"]), Silent())
    assert isinstance(listed, Outcome)
    assert {one["name"]: one["reached"] for one in listed.data} == {"old": False, "shelf": True}
    assert listed.text.count("where no robot is now") == 1


async def test_a_robot_goes_to_what_is_typed_angles_in_degrees_and_to_no_word(
    realm: Realm, operator: Operator
) -> None:
    await at_plan(operator)
    await operator.press("G")
    dialog = await operator.at(GoDialog)
    dialog.query_one("#at-x", Input).value = "far"
    way = dialog.query_one("#going-way", CachedText)
    await operator.until(lambda: "'far' is not a number" in str(way.render()), "the complaint")
    assert dialog.query_one("#yes", Button).disabled
    await operator.press("escape")
    assert realm.arm.calls == []
    await operator.press("G")
    dialog = await operator.at(GoDialog)
    assert dialog.query_one("#at-twist", Input).value == "0.0"
    dialog.query_one("#at-twist", Input).value = "45"
    dialog.query_one("#at-x", Input).value = "0.3"
    await operator.until(lambda: not dialog.query_one("#yes", Button).disabled, "it would go")
    dialog.query_one("#yes", Button).focus()
    await operator.press("enter")
    await operator.until(lambda: abs(realm.arm.pose["twist"] - math.pi / 4) < 1e-3, "it turned")
    await operator.sees("twist 45.0°")


async def test_a_click_moves_the_cursor_a_click_on_it_chooses_and_a_point_of_the_robots_frame_gets_a_name(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = await at_plan(operator)
    await operator.click("#plan")
    assert plan.cursor is not None
    await operator.click("#plan")
    await operator.at(GoDialog)
    await operator.press("escape")
    await operator.at(MainPage)
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(MainPage, "ground", "floor")
        await operator.press("K")
        await operator.sees("arm-1 moves in another frame, and the point is of floor")
    await operator.press("K")
    await operator.at(NameDialog)
    await operator.type("shelf")
    await operator.press("enter")
    await operator.sees("this realm keeps nothing, so it has no places")


async def test_a_point_in_a_picture_is_where_the_robot_goes(realm: Realm, operator: Operator) -> None:
    """The camera is 1 m above x = 0.3 and sees 90 degrees: the middle of the picture is that point."""
    await at_plan(operator)
    await operator.press("v")
    picture = operator.one(PointedPicture, "#pointed")
    await operator.until(lambda: picture.lens is not None, "a picture with its camera")
    picture.focus()
    await operator.press("up")
    assert picture.point == pytest.approx({"x": 0.3, "y": 0.0}, abs=1e-9)
    await operator.press("up", "up", "right")
    point, field = picture.point, picture.field
    assert point is not None
    assert point["y"] == pytest.approx(2 * 2 / field.height)
    assert point["x"] == pytest.approx(0.3 + 2 * picture.aspect / field.width)
    await operator.press("enter")
    dialog = await operator.at(GoDialog)
    dialog.query_one("#yes", Button).focus()
    await operator.press("enter")
    await operator.until(lambda: abs(realm.arm.pose["y"] - point["y"]) < 1e-3, "it is there")


async def test_cameras_stand_side_by_side_and_an_arm_is_a_skeleton_where_pictures_are_too_much(
    operator: Operator,
) -> None:
    await operator.press("v")
    picture = operator.one(PointedPicture, "#pointed")
    await operator.until(lambda: picture.frames > 0, "a picture")
    await operator.press("Y")
    await operator.until(
        lambda: (
            {one.of for one in operator.app.screen.query(PointedPicture) if one.frames and one.seen}
            == {("cell", "cell"), ("cell", "wrist")}
        ),
        "both cameras",
    )
    await operator.sees("cell / cell", "cell / wrist")
    await operator.press("Y")
    await operator.until(lambda: picture.seen, "one picture again")
    await operator.press("l", "y")
    await operator.sees("skeleton: from the left side", "◎tool")
    assert not picture.seen, "nothing is fetched"
    await operator.press("y")
    await operator.until(lambda: picture.seen, "a picture again")


@pytest.mark.parametrize(
    ("able", "sequence"),
    [
        (PictureAbility("kitty"), r"\x1b_Ga=T,U=1,q=2"),
        (PictureAbility("sixel", (8, 16)), r"\x1b7\x1b\[\d+;\d+H\x1bP0;1;0q"),
    ],
    ids=["kitty", "sixel"],
)
async def test_a_picture_is_sent_in_pixels(
    able: PictureAbility, sequence: str, operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
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
