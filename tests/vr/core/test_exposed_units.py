"""Commands of a child under other names and in other units."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import pytest

from robotree.vr import Child, Range, Robot, Unit, VirtualRobot, command
from robotree.vr.base.errors import BadArgument
from robotree.vr.running.process import Process


class Place(msgspec.Struct):
    x: Annotated[float, Unit("m")]
    turns: int


class Arm(Robot):
    """In metres."""

    x = 0.25

    @command
    def go_to(self, x: Annotated[float, Unit("m"), Range(-1, 1)], n: int = 1) -> Annotated[float, Unit("m")]:
        self.x = x * n
        return self.x

    @command(effect="read")
    def get_info(self) -> Place:
        return Place(self.x, 3)


class Workshop(VirtualRobot):
    """In millimetres."""

    arm = Child("Arm")
    move = arm.exposed("go_to", x=Unit("mm"), result=Unit("cm"))
    where = arm.exposed("get_info", x=Unit("mm"))
    go_to = arm.exposed()
    heavy = arm.exposed("go_to", x=Unit("kg"))
    odd = arm.exposed("go_to", y=Unit("mm"))


@pytest.fixture(params=["a process each", "one process"])
async def workshop(request: pytest.FixtureRequest, realm: Any) -> Any:
    if request.param == "one process":
        realm.shared = Process(realm.runner)
    workshop, arm = await realm.start(Workshop("workshop")), await realm.start(Arm("arm-1"))
    await realm.client(workshop).enslave("arm", arm.address)
    workshop.arm = arm
    return workshop


async def test_arguments_and_results_are_converted_on_the_way(realm: Any, workshop: Any) -> None:
    client = realm.client(workshop)
    assert await client.call("move", {"x": 300}) == pytest.approx(30)
    assert workshop.arm.robot.x == pytest.approx(0.3)
    assert await client.call("move", {"x": "10 cm", "n": 2}) == pytest.approx(20)
    assert await client.call("where", {}) == {"x": pytest.approx(200), "turns": 3}
    assert await client.call("go_to", {"x": 0.5}) == 0.5, "without units it is the child's own"


async def test_callers_see_their_units_and_limits(realm: Any, workshop: Any) -> None:
    spec = (await realm.client(workshop).describe()).command("move")
    x = spec.parameters[0]
    assert (x.unit, x.lower, x.upper, spec.result[0].unit) == ("mm", -1000, 1000, "cm")
    with pytest.raises(BadArgument, match=r"2000 mm is out of range; give a number in mm from -1000 to 1000"):
        await realm.client(workshop).call("move", {"x": 2000})


async def test_units_that_do_not_fit_say_so(realm: Any, workshop: Any) -> None:
    with pytest.raises(BadArgument, match="kg cannot be turned into m"):
        await realm.client(workshop).call("heavy", {"x": 1})
    with pytest.raises(BadArgument, match=r"arm.go_to has no 'y' with a unit"):
        await realm.client(workshop).call("odd", {"x": 1})
    assert not (await realm.client(workshop).describe()).command("odd").available
