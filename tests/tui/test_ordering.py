"""The line that leaves an order says which of several robots of one name is meant."""

from __future__ import annotations

import pytest

from robotree.tui.errors import ValueRefused
from robotree.tui.line import manual, ordering
from robotree.tui.seen import absence
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import SeveralRobots
from robotree.vr.base.order import KnownAgent, Order, OrderHold

parse = manual.shell().parse


class Orders:
    """What is asked of the directories."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    async def leave(self, *_: object, identity: str = "", **__: object) -> object:
        self.asked.append(identity)
        raise SeveralRobots(name="r1", count=2, known="ab12, cd34", example="--robot ab12")


class Client:
    def __init__(self) -> None:
        self.orders = Orders()


def test_a_robot_that_was_stopped_again_and_again_has_one_line() -> None:
    holds = [
        OrderHold(id="1", by="anna", at=20.0),
        OrderHold(id="2", by="ben", at=10.0),
        OrderHold(id="3", by="anna", at=30.0),
        OrderHold(id="4", by="anna", at=30.0, identity="i", robot="rover-1"),
    ]
    assert ordering.held(holds, "R releases it") == [
        f"every robot that is away is held since {absence.clock(10.0)} by anna, ben: R releases it",
        f"rover-1 is held since {absence.clock(30.0)} by anna: R releases it",
    ]


def test_an_order_whose_robot_asks_a_person_says_how_to_answer() -> None:
    order = Order(key="0123456789ab", robot="cart", command="roll", state="taken")
    assert "asks" not in ordering.table([order])
    assert "asks: `robotree decide cart done|again|abort`" in ordering.table([order], asking={"cart"})
    assert "robotree decide cart" in ordering.portrait(order, {"cart"})


async def test_the_advice_of_the_error_can_be_typed() -> None:
    client = Client()
    with pytest.raises(SeveralRobots) as refused:
        await ordering.leave(client, parse(["call", "r1.move", "x=1", "--queue"]), None)  # type: ignore[arg-type]
    advice = str(refused.value).rpartition(": ")[2]
    with pytest.raises(SeveralRobots):
        await ordering.leave(client, parse(f"call r1.move x=1 --queue {advice}".split()), None)  # type: ignore[arg-type]
    assert client.orders.asked == ["", "ab12"]


def test_the_stop_of_a_robot_that_is_away_is_the_one_that_it_was_last_in() -> None:
    robot = RobotDescription(
        address=Address("robot", "tele", "1"), kinds=("Thing",), stopped=True, stop_reason="anna's stop"
    )
    known = KnownAgent(name="tele", identity="ab", robot=robot, described=50.0, seen=60.0)
    rows = ordering.known_portrait(known, 100.0).splitlines()
    state, stopped = (next(row for row in rows if word in row) for word in ("state ", "anna's stop"))
    assert stopped.startswith("was stopped  ")
    assert state.index("away since") == stopped.index("anna's"), "in one column"


@pytest.mark.parametrize("text", ["soon", "25:00", "12:x", "1 week", "-5min"])
def test_what_is_no_end_is_refused_with_all_forms_that_are_one(text: str) -> None:
    with pytest.raises(ValueRefused, match=r"30min, 2h or 3d .* 18:00"):
        ordering.until(text)


async def test_a_call_at_once_needs_no_identity() -> None:
    with pytest.raises(ValueRefused, match="--queue"):
        await ordering.call_or_leave(Client(), parse(["call", "r1.move", "--robot", "ab12"]), None)  # type: ignore[arg-type]
