"""What is left for a robot that is away happens once, when it is back."""

from __future__ import annotations

from robotree.vr.orders.ledger import Ledger
from tests.vr.orders.conftest import Rover, Stage


async def test_an_order_is_carried_out_once_when_its_robot_is_back(stage: Stage) -> None:
    directory = await stage.directory("d1")
    ledger = Ledger(None)
    agent = await stage.robot(Rover("r1"), ledger)
    person = await stage.person()
    await stage.until(lambda: directory.book.store.agents)
    await stage.switch_off(agent)
    left = await person.orders.leave("r1", "drive", {"x": "50 cm"})
    assert left.order.state == "waiting"
    assert left.order.arguments == {"x": 0.5}
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    key = left.order.key
    await stage.until(lambda: directory.book.store.orders[key].over)
    done = directory.book.store.orders[key]
    assert (done.state, done.value, rover.done) == ("done", 0.5, [key])
    assert [each.key for each in await person.orders.inbox()] == [key]
    await person.orders.mark_seen([done])
    assert not await person.orders.inbox()
