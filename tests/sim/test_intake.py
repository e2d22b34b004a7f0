"""The way from the links to the physics: bounded, fair, and never in the way of a stop."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Frame
from robotree.protocol.messages import (
    CommandLong,
    Goal,
    GoalState,
    GoalStatus,
    MavCmd,
    Mode,
    ModeKind,
    Ping,
    SetMode,
    Setpoint,
    Verb,
)
from robotree.sim.firmware import Outgoing
from robotree.sim.serving.intake import CREDIT, LARGEST_QUEUE, LARGEST_STOPS, Closed, Heard, Intake, Opened
from robotree.sim.testing import NAN, ArmBench, RoverBench

STOP = Frame.of(SetMode(0, 0, 0, ModeKind.SAFE_STOP))


def ping(number: int) -> Frame:
    return Frame.of(Ping(0, number))


def numbers(intake: Intake, via: str) -> list[int]:
    return [
        event.frame.message.seq
        for event in intake.take()
        if isinstance(event, Heard) and event.via == via and isinstance(event.frame.message, Ping)
    ]


def test_frames_of_a_link_come_in_their_order_between_its_opening_and_its_end() -> None:
    intake = Intake(1)
    intake.open("link")
    intake.put(ping(1), "link")
    intake.put(ping(2), "link")
    intake.close("link")
    kinds = [type(event) for event in intake.take()]
    assert kinds == [Opened, Heard, Heard, Closed]
    assert intake.take() == []


@given(flood=st.integers(0, 3 * LARGEST_QUEUE))
def test_a_flood_is_bounded_and_what_is_dropped_is_counted(flood: int) -> None:
    intake = Intake(1)
    for i in range(flood):
        intake.put(ping(i), "flooder")
    assert intake.dropped == max(0, flood - LARGEST_QUEUE)
    heard: list[int] = []
    while turn := numbers(intake, "flooder"):
        assert len(turn) <= CREDIT
        heard += turn
    assert heard == list(range(min(flood, LARGEST_QUEUE)))


def test_a_flood_does_not_delay_others() -> None:
    intake = Intake(1)
    for i in range(10_000):
        intake.put(ping(i), "flooder")
    intake.put(ping(7), "other")
    assert numbers(intake, "other") == [7]


def goal(key: int, verb: Verb) -> Frame:
    return Frame.of(Goal(key, 0, 0, (0.3, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0), verb, 1, 1))


@pytest.mark.parametrize(
    ("frame", "per_second"),
    [
        (ping(1), 3200),
        (goal(1, Verb.STATUS), 3200),
        (goal(1, Verb.GO_TO), 50),
        (Frame.of(Setpoint(0, 0, 1, (0.0,) * 7, 100, 1, 1, 1)), 400),
        (Frame.of(CommandLong(1, 1, MavCmd.ROBOTREE_GO_TO, 0, *(0.0,) * 7)), 50),
    ],
)
def test_what_takes_long_is_heard_less_often(frame: Frame, per_second: int) -> None:
    intake, heard = Intake(1), 0
    for _ in range(200):
        for _ in range(20):
            intake.put(frame, "flooder")
        heard += len(intake.take())
    assert heard == pytest.approx(per_second, rel=0.03)


def test_many_flooders_share_what_there_is() -> None:
    intake, heard = Intake(1), 0
    for _ in range(200):
        for via in range(32):
            intake.put(ping(1), via)
            intake.put(ping(1), via)
            intake.put(ping(1), via)
        heard += len(intake.take())
    assert heard == 200 * 64


def test_a_stop_goes_before_everything_even_of_the_flooder_itself() -> None:
    intake = Intake(1)
    for i in range(10_000):
        intake.put(ping(i), "flooder")
    intake.put(STOP, "flooder")
    first = intake.take()[0]
    assert isinstance(first, Heard)
    assert first.frame is STOP


def test_a_flood_of_stops_is_bounded_and_still_a_stop() -> None:
    intake = Intake(1)
    for _ in range(10_000):
        intake.put(STOP, "flooder")
    assert len(intake.take()) == LARGEST_STOPS
    assert intake.dropped == 10_000 - LARGEST_STOPS, "who is not answered is counted"


def test_stops_for_others_leave_a_stop_for_us_its_place() -> None:
    intake = Intake(1)
    for _ in range(10 * LARGEST_STOPS):
        intake.put(Frame.of(SetMode(0, 2, 1, ModeKind.SAFE_STOP)), "relay")
        intake.put(Frame.of(CommandLong(3, 1, MavCmd.COMPONENT_ARM_DISARM, 0, *(0.0,) * 7)), "relay")
    intake.put(STOP, "relay")
    first = intake.take()[0]
    assert isinstance(first, Heard)
    assert first.frame is STOP
    assert intake.dropped == 0
    assert intake.stops == 1, "a stop for another system is none here"


def test_the_end_of_a_link_is_never_dropped() -> None:
    intake = Intake(1)
    for i in range(10_000):
        intake.put(ping(i), "flooder")
    intake.close("flooder")
    events = [event for _ in range(LARGEST_QUEUE) for event in intake.take()]
    assert events[-1] == Closed("flooder")


def test_a_link_that_has_ended_has_one_more_turn() -> None:
    intake = Intake(1)
    for i in range(100):
        intake.put(ping(i), "link")
    intake.put(STOP, "link")
    intake.close("link")
    intake.put(ping(7), "other")
    events = intake.take()
    assert isinstance(events[0], Heard)
    assert events[0].frame is STOP, "a stop goes before everything, also before the end of its link"
    assert [type(event) for event in events if event.via == "link"] == [Heard] * (1 + CREDIT) + [Closed]
    assert intake.dropped == 100 - CREDIT
    assert intake.take() == []


def test_an_arrival_keeps_its_moment_however_long_it_waits() -> None:
    intake = Intake(1)
    for i in range(3 * CREDIT):
        intake.put(ping(i), "link", now=10 * i)
    heard = [event for _ in range(3) for event in intake.take()]
    assert [event.arrived for event in heard if isinstance(event, Heard)] == [
        10 * i for i in range(3 * CREDIT)
    ]


PEER = {"system": 255, "component": 190}


def moves(count: int) -> list[Frame]:
    """Goals that move the rover to and fro."""
    rest = (0.0, 0.05, *(NAN,) * 4)
    places = ((0.5 if key % 2 else -0.5, *rest) for key in range(1, count + 1))
    return [Frame.of(Goal(key, 1, 0, place, Verb.MOVE, 1, 1), **PEER) for key, place in enumerate(places, 1)]


def begun(out: list[Outgoing]) -> int:
    statuses = [each.message for each in out if isinstance(each.message, GoalStatus)]
    return len({status.key for status in statuses if status.state == GoalState.ACTIVE})


def test_who_has_fallen_silent_is_missed_although_words_of_it_still_wait() -> None:
    controller = RoverBench(silence=0.5).controller
    controller.greet("link")
    for frame in moves(LARGEST_QUEUE - 1):
        controller.post(frame, "link")
    began, modes = controller.cell.time_ms, dict[int, ModeKind]()
    while (after := controller.cell.time_ms - began) < 6000:
        controller.advance()
        modes[after] = controller.firmware.mode
    assert modes[400] == ModeKind.ACTIVE
    assert {mode for after, mode in modes.items() if after > 520} == {ModeKind.HOLD}


def test_what_waits_when_its_link_ends_is_not_begun() -> None:
    controller = RoverBench(silence=0.5).controller
    controller.greet("link")
    controller.advance()
    for frame in moves(LARGEST_QUEUE - 1):
        controller.post(frame, "link")
    controller.leave("link")
    assert begun([each for _ in range(1200) for each in controller.advance()]) == 1


def test_a_set_point_that_waited_longer_than_it_lives_is_not_obeyed() -> None:
    controller = RoverBench().controller
    kind = min(controller.cell.device.setpoint_kinds)
    for number in range(1, LARGEST_QUEUE):
        point = Setpoint(0, 1, number, (0.3, 0.0, *(NAN,) * 5), 50, 1, 1, kind)
        controller.post(Frame.of(point, **PEER), "link")
    modes = list[ModeKind]()
    for _ in range(200):
        controller.advance()
        modes.append(controller.firmware.mode)
    assert modes[2] == ModeKind.ACTIVE
    assert set(modes[12:]) == {ModeKind.READY}, "it moves for as long as a set-point lives, and no longer"


def test_a_flooder_costs_itself_the_others_goals_and_pace_stay() -> None:
    arm = ArmBench()
    arm.operator.ask(Verb.GO_TO, 0.35, -0.25, 0.35, 0.5)
    arm.operator.wait(0.1)
    before = len(arm.operator.all(Mode))
    for _ in range(100):
        for i in range(500):
            arm.controller.post(ping(i), "flooder")
        arm.operator.step()
    assert arm.operator.latest(GoalStatus).progress > 0.1
    assert len(arm.operator.all(Mode)) - before == pytest.approx(1, abs=1)
    assert arm.controller.firmware.gauges.overrun > 40_000
