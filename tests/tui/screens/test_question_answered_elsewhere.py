"""A question that another program has answered meanwhile is closed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.seen.selection import Place

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_the_question_to_resume_closes_when_somebody_else_has_resumed_those_that_it_is_about(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
        await realm.realm_client.stop(None)
        await operator.sees("PROTECTIVE STOP: arm-1, rover-1 — R resumes")
        await operator.press("R")
        await operator.at(Confirm)
        await operator.sees("resume?", "arm-1, rover-1 may move again")
        await realm.realm_client.resume("rover-1")
        await operator.until(lambda: operator.app.store.stopped == ("arm-1",), "one is released")
        await operator.at(Confirm)
        await realm.realm_client.resume("arm-1")
        await operator.at(MainPage)
        await operator.sees("no need to resume: the stop of arm-1, rover-1 has ended meanwhile")
        await operator.obey("resume")
        await operator.at(Confirm)
        await operator.sees("All robots may move again")
        await operator.press("escape")
        await operator.at(MainPage)
        await realm.realm_client.stop(None)
        await operator.sees("PROTECTIVE STOP: arm-1, rover-1")
        await operator.obey("resume rover-1")
        await operator.at(Confirm)
        await realm.realm_client.resume("rover-1")
        await operator.at(MainPage)
        await operator.sees(
            "no need to resume: the stop of rover-1 has ended meanwhile", "PROTECTIVE STOP: arm-1"
        )


async def test_the_question_to_delete_closes_when_another_robot_has_taken_the_name(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "mover" in operator.app.store.descriptions, "its description")
        operator.app.ask_for("delete", Place("mover"))
        await operator.at(Confirm)
        await operator.sees("delete mover?", "mover ends for good")
        await realm.realm_client.delete("mover")
        await realm.create("two_arms.py", "mover")
        await operator.at(MainPage)
        await operator.until(
            lambda: any("mover " in entry.text for entry in operator.app.store.entries), "it is told"
        )
        assert "mover" in {robot.name for robot in await realm.realm_client.tree()}, "the new one lives"


async def test_the_question_to_release_names_the_child_and_closes_when_the_slot_has_another_one(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    async with operate(realm.realm_client) as operator:
        store = operator.app.store
        await operator.until(
            lambda: "mover" in store.descriptions and bool(store.descriptions["mover"].slots[0].child), "bond"
        )
        operator.app.ask_for("release", Place("mover"))
        await operator.at(Confirm)
        await operator.sees("release mover.arm?", "arm-1 stops what it does for mover")
        await realm.realm_client.release("mover", "arm")
        await operator.at(MainPage)
        await operator.sees("mover.arm is empty now, not arm-1")
