"""What is known of a robot, and for how long."""

import math

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import Gripper, Heartbeat, Mode, NamedValueFloat, Tool
from robotree.proxy.twin import Twin

TOOL = Tool(5, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 0.4, 0.5, 0.6, (0, 0, 32767, 0), 1)


def test_before_anything_was_heard_nothing_is_known() -> None:
    twin = Twin()
    assert twin.readings(now=0.0) == {}
    assert twin.latest(Tool) is None
    assert twin.age(now=0.0) == math.inf


def test_readings_of_several_messages_stand_together() -> None:
    twin = Twin()
    twin.update(TOOL, now=1.0)
    twin.update(Gripper(5, 0.04, 0.08, 2.0, 1), now=1.1)
    assert twin.readings(now=1.2).items() >= {"x": 0.1, "fz": 3.0, "width": 0.04}.items()
    assert twin.latest(Tool) == TOOL


def test_a_silent_robot_keeps_its_readings_and_they_grow_old() -> None:
    twin = Twin()
    twin.update(TOOL, now=1.0)
    assert twin.age(now=2.5) == 1.5
    assert twin.after(Tool, 0.9) == TOOL
    assert twin.after(Tool, 1.0) is None
    old = twin.readings(now=61.0)
    assert old["age"] == 60.0
    assert old["x"] == 0.1


def test_a_heartbeat_is_a_sign_of_life_but_measures_nothing() -> None:
    twin = Twin()
    twin.update(Heartbeat(0, 0, 0, 0, 4), now=1.0)
    twin.update(Mode(5, 7, 1000, 1, 0), now=1.0)
    assert twin.age(now=1.0) == math.inf
    assert twin.readings(now=1.0) == {}
    assert twin.latest(Mode) == Mode(5, 7, 1000, 1, 0)


@given(values=st.lists(st.floats(width=32), min_size=1), gap=st.floats(0, 100))
def test_a_reading_is_the_last_number_heard(values: list[float], gap: float) -> None:
    twin = Twin()
    for i, value in enumerate(values):
        twin.update(NamedValueFloat(i, "lever", value), now=float(i))
    finite = [value for value in values if math.isfinite(value)]
    readings = twin.readings(now=len(values) - 1 + gap)
    assert readings.get("lever") == (finite[-1] if finite else None)
