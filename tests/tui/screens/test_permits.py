"""What assistants ask for: seen, looked at and answered by a person on both screens."""

from __future__ import annotations

import io
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace
from PIL import Image
from textual.containers import VerticalScroll
from textual.widgets import OptionList

from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.surface import Surface
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.permits import PermitDialog, PermitsPage
from robotree.tui.screen.pages.user import UserPage
from robotree.tui.screen.user_app import UserApp
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.row_list import RowList
from robotree.vr.base.permit import Permit
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import user_name
from robotree.vr.network.permit_file import PermitFiles

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


class Gate(PolicyGate):
    """The gate of a realm that keeps permits."""

    def __init__(self, folder: Path) -> None:
        self.permits = PermitFiles(folder)


@pytest.fixture
def permits(realm: Realm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PermitFiles:
    gate = Gate(tmp_path)
    monkeypatch.setattr(realm.realm_client._transport, "gate", gate)
    return gate.permits


def asked(id_: str, x: float = 0.5) -> Permit:
    return Permit(
        id=id_, assistant="claude", robot="arm-1", life="", stops=0, command="go_to",
        arguments={"x": x}, units={"x": "m"}, why="the lever [/x] is open", asked=time.time(),
        preview=("it would go 0.21 m",),
    )  # fmt: skip


async def test_a_person_sees_that_an_assistant_asks_and_answers_in_a_dialog(
    realm: Realm, operate: Operate, permits: PermitFiles
) -> None:
    jpeg = io.BytesIO()
    Image.new("RGB", (64, 36), (200, 30, 30)).save(jpeg, "JPEG")
    async with operate(realm.realm_client) as operator:
        permits.ask(asked("aaaaaaaa"), jpeg.getvalue())
        await operator.sees("1 permit waits: P", "claude asks for arm-1.go_to(x=0.5 m)")
        permits.ask(asked("bbbbbbbb", 0.7))
        await operator.sees("2 permits wait: P")
        await operator.press("P")
        await operator.at(PermitsPage)
        await operator.sees("aaaaaaaa", "bbbbbbbb")
        await operator.press("enter")
        page = await operator.at(PermitDialog)
        await operator.sees("May claude do this, once?", "x=0.5 m", "the lever [/x] is open", "0.21 m")
        assert page.query_one(".dialog").outer_size.width == 96
        assert page.query_one(VerticalScroll).max_scroll_y == 0, "all of it is in sight"
        await operator.until(lambda: page.query_one(PictureView).frames > 0, "the picture")
        await operator.sees("\u2580")
        await operator.press("enter")  # the harmless answer has the focus
        await operator.at(PermitsPage)
        assert {one.id for one in permits.waiting()} == {"aaaaaaaa", "bbbbbbbb"}
        await operator.press("enter")
        await operator.at(PermitDialog)
        await operator.press("tab", "enter")
        await operator.until(lambda: permits.find("aaaaaaaa").state == "allowed", "it is allowed")
        await operator.at(PermitsPage)
        await operator.until(lambda: "aaaaaaaa" not in operator.text, "it is off the list")
        await operator.press("enter")
        await operator.at(PermitDialog)
        permits.answer("bbbbbbbb", yes=False, by="bert@pts/9")
        await operator.at(PermitsPage)
        await operator.sees("no permit waits for an answer", "waits for no answer any more")
        await operator.press("escape")
        await operator.at(MainPage)
        await operator.until(lambda: "permit waits" not in operator.text, "none waits")


async def test_a_choice_whose_permit_has_gone_asks_about_no_other_one(
    realm: Realm, operate: Operate, permits: PermitFiles
) -> None:
    async with operate(realm.realm_client) as operator:
        permits.ask(asked("aaaaaaaa"))
        permits.ask(asked("bbbbbbbb", 0.7))
        await operator.sees("2 permits wait: P")
        await operator.press("P")
        page = await operator.at(PermitsPage)
        permits.answer("aaaaaaaa", yes=False, by="bert@pts/9")
        page.query_one(RowList).action_select()
        operator.app.store.take_permits(permits.waiting(), operator.app.now(), "")
        page._look()
        await operator.settled()
        await operator.at(PermitsPage)


async def test_who_may_not_command_the_robot_cannot_say_yes(
    realm: Realm, operate: Operate, permits: PermitFiles
) -> None:
    realm.realm_client.gate.policy = read_policy(
        f"realm: test\nversion: 1\npersons: {{'{user_name(os.geteuid())}': looker}}\n"
        "roles: {looker: {see: '*'}}\n"
    )
    permits.ask(asked("aaaaaaaa"))
    async with operate(realm.realm_client) as operator:
        await operator.sees("1 permit waits")
        await operator.press("P", "enter")
        page = await operator.at(PermitDialog)
        await operator.sees("may not command")
        assert not page.query("#allow")
        await operator.press("tab", "enter")
        await operator.until(lambda: permits.find("aaaaaaaa").state == "denied", "anybody may say no")


async def test_it_is_a_question_in_the_list_for_users(
    realm: Realm, operate: Operate, permits: PermitFiles
) -> None:
    permits.ask(replace(asked("aaaaaaaa"), why="it is late"))
    async with operate(realm.realm_client, size=(60, 30), kind=UserApp) as operator:
        await operator.sees("Questions", "May claude do this?", "it is late")
        operator.one(OptionList, "#can").highlighted = 1
        await operator.press("enter")
        await operator.at(PermitDialog)
        await operator.press("tab", "enter")
        await operator.until(lambda: permits.find("aaaaaaaa").state == "allowed", "it is allowed")
        await operator.at(UserPage)
        await operator.until(lambda: "May claude" not in operator.text, "the question is answered")


async def test_a_yes_that_a_stop_has_made_useless_is_not_given(realm: Realm, permits: PermitFiles) -> None:
    client = realm.realm_client
    robot = await client.describe("arm-1")
    life = {"life": robot.address.key, "stops": robot.stops}
    permits.ask(replace(asked("aaaaaaaa"), **life))
    permits.ask(replace(asked("bbbbbbbb", 0.6), **life))
    permits.ask(replace(asked("cccccccc", 0.7), life="robot/arm-1/another", stops=robot.stops))

    async def answered(permit: str) -> str:
        outcome = await carry_out(client, Surface(Where.SCRIPT).parse(["permit", "allow", permit]), Silent())
        return str(outcome) if isinstance(outcome, Refusal) else outcome.text

    assert "may begin, once" in await answered("aaaaaaaa")
    await client.stop("arm-1")
    await client.resume("arm-1")
    assert "arm-1 was stopped since it was asked for; the assistant has to ask again" in await answered(
        "bbbbbbbb"
    )
    assert permits.find("bbbbbbbb").state == "waits"
    assert "arm-1 was started anew since it was asked for" in await answered("cccccccc")
