"""What a robot must be to be chosen, read and judged."""

from __future__ import annotations

import pytest

from robotree.vr.base.errors import RequirementUnreadable
from robotree.vr.scripts.requirement import KnownRobot, requirement

R1 = KnownRobot(
    name="r1",
    kinds=("FastRover", "Rover"),
    commands=frozenset({"move"}),
    words={
        "battery": 62.0,
        "place": "hall",
        "charged": "yes",
        "x": 1.0,
        "y": -2.0,
        "colour": "red",
        "share": 0.4,
    },
)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "battery > 30 and near hall",
        "kind = Rover & battery>30",
        "kind = FastRover",
        "kind != Arm",
        "name = r1 | name = r2",
        "battery >= 62 and battery <= 62 and battery = 62",
        "not near kitchen",
        "!near kitchen",
        "near Hall",
        "near 'hall'",
        "charged",
        "colour = red",
        "colour != blue",
        "x*x + y*y < 6",
        "share > 30 %",
        "share < 50%",
        "has move and not has fly",
        "(battery > 90 or near hall) and charged",
        "place = hall",
    ],
)
def test_a_robot_fulfils_it(text: str) -> None:
    assert requirement(text).holds(R1) is True


@pytest.mark.parametrize(
    "text",
    [
        "battery > 70",
        "kind = Arm",
        "near kitchen",
        "speed > 0",
        "not charged",
        "colour > 3",
        "x / 0 > 1",
        "missing",
        "missing = 3",
        "share > 50 %",
        "has fly",
    ],
)
def test_a_robot_does_not_fulfil_it(text: str) -> None:
    assert requirement(text).holds(R1) is False


def test_a_listing_without_readings_leaves_it_open() -> None:
    listed = KnownRobot(name="r1", kinds=("Rover",), words={"place": "hall"}, whole=False)
    assert requirement("battery > 30").holds(listed) is None
    assert requirement("battery > 30 and near hall").holds(listed) is None
    assert requirement("battery > 30 and near kitchen").holds(listed) is False
    assert requirement("battery > 30 or near hall").holds(listed) is True
    assert requirement("not battery > 30").holds(listed) is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("battery >", "something is missing at the end"),
        ("battery > 30 and", "something is missing at the end"),
        ("battery > 30 near hall", "'near' is not expected"),
        ("near", "a name is missing after 'near'"),
        ("near 3", "a name is missing after 'near'"),
        ("(battery > 3", "a bracket is not closed"),
        ("battery $ 3", "'$' cannot stand"),
        ("3", "'3' alone is no condition"),
        ("kind > 3", "kind is no number"),
        ("(near hall) > 3", "a condition cannot stand where a number"),
        ("battery = (x > 3)", "a condition cannot stand where a number"),
        ("not " * 61 + "a", "more than 60 words"),
        ("(" * 13 + "a" + ")" * 13, "more than 12 brackets"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(text: str, reason: str) -> None:
    with pytest.raises(RequirementUnreadable) as refusal:
        requirement(text)
    assert reason in str(refusal.value), refusal.value
    assert "\n" not in str(refusal.value)


def test_what_was_seen_is_told_where_it_was_asked_for() -> None:
    assert requirement("battery > 30 and near hall").seen(R1) == "battery 62, place hall"
    assert requirement("speed > 3").seen(R1) == "no speed"
