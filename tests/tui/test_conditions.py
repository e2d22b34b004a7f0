"""What a session can expect, and when it holds."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.errors import ValueRefused
from robotree.tui.session.conditions import Scene, condition
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription, SlotSpec

MOVER = Address("robot", "mover", "1")
ARM = Address("robot", "arm-1", "2")


def mover(child: Address | None = ARM, busy: str = "") -> RobotDescription:
    slot = SlotSpec(name="arm", kind="Arm", child=child)
    return RobotDescription(
        address=MOVER, kinds=("MoveTo", "VirtualRobot", "Robot"), slots=(slot,), busy=busy
    )


def arm(*, free: bool = False) -> RobotDescription:
    bond = None if free else BondSpec(parent=MOVER, slot="arm", epoch=3, remaining=4.0)
    return RobotDescription(address=ARM, kinds=("Arm", "Robot"), bond=bond)


def scene(
    *robots: RobotDescription, listed: tuple[str, ...] = (), result: Any = None, refusal: str = ""
) -> Scene:
    return Scene(
        listed=frozenset(listed),
        robots={robot.name: robot for robot in robots},
        readings={"cell": {"lever_angle": 0.8}},
        result=result,
        refusal=refusal,
    )


@pytest.mark.parametrize(
    ("text", "there", "seen"),
    [
        ("arm-1 listed", scene(listed=("arm-1",)), None),
        ("arm-1 gone", scene(), None),
        ("arm-1 enslaved by mover.arm", scene(arm()), None),
        ("mover.arm holds arm-1", scene(mover()), None),
        ("mover.arm empty", scene(mover(child=None)), None),
        ("mover idle", scene(mover()), None),
        ("reading cell.lever_angle > 0.75", scene(), None),
        ("reading cell.lever_angle=0.8", scene(), None),
        ("result.z >= 0.29", scene(result={"z": 0.3}), None),
        ("result = 0.3", scene(result=0.3000001), None),
        ("result.pose.x < 1", scene(result={"pose": {"x": 0}}), None),
        ("result = closed", scene(result="closed"), None),
        ("result = true", scene(result=True), None),
        ("result != 3", scene(result=4), None),
        ("refused", scene(refusal="NotInControl"), None),
        ("refused NotInControl", scene(refusal="NotInControl"), None),
        ("done", scene(), None),
        ("arm-1 listed", scene(), "not listed"),
        ("arm-1 gone", scene(arm()), "there"),
        ("arm-1 gone", scene(listed=("arm-1",)), "there"),
        ("arm-1 enslaved by mover.arm", scene(arm(free=True)), "free"),
        ("arm-1 enslaved by mover.arm", scene(), "arm-1 does not answer"),
        ("arm-1 enslaved by other.arm", scene(arm()), "enslaved by mover.arm"),
        ("mover.arm empty", scene(mover()), "holds arm-1"),
        ("mover.leg empty", scene(mover()), "mover has no slot leg"),
        ("mover.arm holds arm-2", scene(mover()), "holds arm-1"),
        ("mover idle", scene(mover(busy="move")), "busy: move"),
        ("reading cell.lever_angle < 0.75", scene(), "0.8"),
        ("reading cell.height > 0", scene(), "cell has no reading height; it has lever_angle"),
        ("reading hall.height > 0", scene(), "hall reports nothing"),
        ("result.z > 0", scene(result={"x": 1}), "the result is x 1"),
        ("result > 0", scene(result="closed"), "closed cannot be compared with 0"),
        ("refused StaleEpoch", scene(refusal="NotInControl"), "NotInControl"),
        ("refused", scene(), "done"),
    ],
)
def test_a_condition_holds_where_it_should_and_else_says_what_was_seen(
    text: str, there: Scene, seen: str | None
) -> None:
    verdict = condition(text).judge(there)
    assert verdict.holds == (seen is None)
    assert seen in {None, verdict.seen}


@pytest.mark.parametrize(
    "text", ["", "arm-1", "arm-1 enslaved by mover", "reading cell.x > high", "result >", "arm-1 lost"]
)
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(ValueRefused, match="expect"):
        condition(text)


@given(number=st.floats(-1e6, 1e6), bound=st.floats(-1e6, 1e6))
def test_larger_and_not_larger_exclude_each_other(number: float, bound: float) -> None:
    there = Scene(result=number)
    larger = condition(f"result > {bound!r}").judge(there).holds
    assert larger != condition(f"result <= {bound!r}").judge(there).holds
    assert larger == (number > bound)


def test_what_is_expected_of_a_group_is_judged_of_each_member() -> None:
    idle, busy = arm(free=True), mover(busy="move")
    robots = {robot.name: robot for robot in (idle, busy)}
    both = Scene(
        robots=robots,
        readings={"arm-1": {"battery": 40.0}, "mover": {"battery": 20.0}},
        groups={"team": ("arm-1", "mover"), "nobody": ()},
    )
    holds = {
        "all of team idle": False,
        "any of team idle": True,
        "all of team reading battery > 30": False,
        "all of team reading battery > 10": True,
        "any of team enslaved by mover.arm": False,
        "all of nobody idle": False,
        "all of strangers idle": False,
    }
    assert {text: condition(text).judge(both).holds for text in holds} == holds
    assert "mover: busy: move" in condition("all of team idle").judge(both).seen
    assert condition("all of team idle").group == "team"
    with pytest.raises(ValueRefused):
        condition("all of team happy")
