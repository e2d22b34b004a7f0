"""A question that somebody else has answered meanwhile is not asked any longer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.pages.main import MainPage

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_the_question_to_resume_closes_when_somebody_else_has_resumed(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.fleet) as operator:
        await realm.fleet.stop(None)
        await operator.sees("PROTECTIVE STOP: arm-1, rover-1 — R resumes")
        await operator.press("R")
        await operator.at(Confirm)
        await operator.sees("resume?", "arm-1, rover-1 may move again")
        await realm.fleet.resume("rover-1")
        await operator.until(lambda: operator.app.store.stopped == ("arm-1",), "one is released")
        await operator.at(Confirm)
        await realm.fleet.resume("arm-1")
        await operator.at(MainPage)
        await operator.sees("no need to resume: the stop of arm-1, rover-1 has ended meanwhile")
        await operator.obey("resume")
        await operator.at(Confirm)
        await operator.sees("All robots may move again")


async def test_the_question_about_one_robot_is_not_answered_by_another(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.fleet) as operator:
        await realm.fleet.stop(None)
        await operator.sees("PROTECTIVE STOP: arm-1, rover-1")
        await operator.obey("resume rover-1")
        await operator.at(Confirm)
        await realm.fleet.resume("rover-1")
        await operator.at(MainPage)
        await operator.sees(
            "no need to resume: the stop of rover-1 has ended meanwhile", "PROTECTIVE STOP: arm-1"
        )
