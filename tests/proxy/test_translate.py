"""Laws of the translation between commands and the wire, and what is known of a robot, and for how long."""

import math

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import (
    Gripper,
    Heartbeat,
    Joints,
    LocalPositionNed,
    Mode,
    NamedValueFloat,
    Tool,
)
from robotree.proxy.translate import goal_key, readings_of, time_to_live, twist_of
from robotree.proxy.twin import Twin


@given(key=st.text())
def test_the_same_command_is_the_same_goal_and_never_goal_zero(key: str) -> None:
    assert goal_key(key) == goal_key(key)
    assert 0 < goal_key(key) < 2**64


@given(keys=st.sets(st.text(max_size=40), min_size=2, max_size=50))
def test_different_commands_are_different_goals(keys: set[str]) -> None:
    assert len({goal_key(key) for key in keys}) == len(keys)


@given(orders=st.sets(st.tuples(st.text(max_size=40), st.integers(0, 2**64 - 1)), min_size=2, max_size=50))
def test_different_motions_of_commands_are_different_goals(orders: set[tuple[str, int]]) -> None:
    assert len({goal_key(key, number) for key, number in orders}) == len(orders)


@given(remaining=st.floats(-100, 1e12))
def test_a_deadline_never_becomes_for_ever(remaining: float) -> None:
    on_wire = round(time_to_live(remaining) * 1000)
    assert 1 <= on_wire <= 2**32 - 1
    if 0.001 <= remaining <= 4e6:
        assert abs(on_wire / 1000 - remaining) <= 0.000_501


def test_no_deadline_means_until_reached() -> None:
    assert time_to_live(math.inf) == 0.0


@given(twist=st.floats(-3.14, 3.14))
def test_the_twist_is_read_from_the_orientation_of_a_tool_that_points_down(twist: float) -> None:
    # q = q(Rz twist) q(Ry pi), scaled as on the wire
    half = twist / 2
    q = (0.0, -math.sin(half), math.cos(half), 0.0)
    wire = tuple(round(32767 * part) for part in q)
    assert math.isclose(twist_of(wire), twist, abs_tol=2e-4)


def test_an_orientation_of_zeros_reads_as_no_twist() -> None:
    assert twist_of((0, 0, 0, 0)) == 0.0


def test_telemetry_reads_in_si_units_and_in_the_frame_of_the_cell() -> None:
    tool = Tool(5, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 0.4, 0.5, 0.6, (0, 0, 32767, 0), 1)
    assert readings_of(tool) == {
        "x": 0.1, "y": 0.2, "z": 0.3, "twist": 0.0,
        "fx": 1.0, "fy": 2.0, "fz": 3.0, "tx": 0.4, "ty": 0.5, "tz": 0.6,
    }  # fmt: skip
    assert readings_of(Gripper(5, 0.04, 0.08, 2.0, 1)) == {"width": 0.04, "grip_force": 2.0}
    assert readings_of(Joints(5, (1.0, 2.0, *(0.0,) * 6), 2)) == {"j1": 1.0, "j2": 2.0}
    assert readings_of(NamedValueFloat(5, "lever", 0.7)) == {"lever": 0.7}
    assert readings_of(NamedValueFloat(5, "peak_f", 9.0)) == {"peak_force": 9.0}
    assert readings_of(Heartbeat(0, 0, 0, 0, 4)) == {}


def test_a_mobile_base_reports_north_east_down_and_reads_forward_left() -> None:
    north_east = LocalPositionNed(5, 1.0, 2.0, -0.1, 0.3, 0.4, 0.0)
    assert readings_of(north_east) == {"x": 1.0, "y": -2.0, "vx": 0.3, "vy": -0.4}


@given(value=st.sampled_from([math.nan, math.inf, -math.inf]))
def test_what_is_no_number_is_no_reading(value: float) -> None:
    assert readings_of(NamedValueFloat(5, "lever", value)) == {}


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
