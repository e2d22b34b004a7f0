"""The list of robots while no lookup service runs, and after a process was killed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.vr import Robot
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_who_comes_after_the_last_lookup_service_sees_what_ls_lists_marked_stale(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    realm.network.kill(realm.members["lookup-1"])
    await until(lambda: realm.realm_client.stale, "the lookup service has gone")
    realm_client = RealmClient(realm.network.join("newcomer"))
    await realm_client.start()
    async with operate(realm_client) as operator:
        await operator.sees("STALE: no lookup service is left", "mover", "rover-1", "● free stale", "2 free")
        assert set(operator.one(RobotTable).names) == {"mover", "arm-1", "rover-1"}
        assert set(operator.app.store.robots) == {"mover", "rover-1"}, "the enslaved arm is on no list"
        await operator.until(lambda: set(operator.app.store.views) == {"cell"}, "the view")
        await realm.robot(Robot("late-1"))
        await operator.sees("late-1 (Robot) has come, but no lookup service lists it", "3 free")
        await realm.lookup("lookup-2")
        listed = {"mover", "rover-1", "late-1"}
        await operator.until(
            lambda: not operator.app.store.stale and set(operator.app.store.robots) == listed, "the new list"
        )
        told = [happening.text for happening in operator.app.store.entries]
        assert "a lookup service is back" in told
        assert not [text for text in told if "left the list" in text], "they were on none"
        await operator.until(lambda: "stale" not in operator.text, "nothing is in doubt")
    await realm_client.close()


async def test_the_death_of_an_enslaved_robots_process_is_told_once_and_its_hanging_is_none(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    await realm.create("move_square.py", "square")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    await realm.realm_client.enslave("square", "rover", "rover-1")
    async with operate(realm.realm_client) as operator:
        store = operator.app.store
        await operator.until(lambda: len(store.enslaved) == 2, "both are known to be enslaved")
        realm.network.freeze(realm.members["rover-1"])
        realm.network.kill(realm.members["arm-1"])
        operator.app.feed.hint()
        await operator.sees("✗ arm-1 (Arm): its process has gone")
        await realm.realm_client.delete("mover")
        await operator.until(lambda: "mover" not in store.descriptions, "the next look")
        gone = [happening.text for happening in store.entries if "has gone" in happening.text]
        assert gone == ["arm-1 (Arm): its process has gone"]
        realm.network.thaw(realm.members["rover-1"])
