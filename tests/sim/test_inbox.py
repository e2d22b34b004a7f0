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
from robotree.sim.controller.controller import (
    CREDIT,
    LARGEST_QUEUE,
    LARGEST_STOPS,
    Closed,
    Inbox,
    Opened,
    Received,
)
from robotree.sim.firmware import Outgoing
from robotree.sim.testing import NAN, ArmBench, RoverBench

STOP = Frame.of(SetMode(0, 0, 0, ModeKind.SAFE_STOP))


def ping(number: int) -> Frame:
    return Frame.of(Ping(0, number))


def numbers(inbox: Inbox, via: str) -> list[int]:
    return [
        event.frame.message.seq
        for event in inbox.take()
        if isinstance(event, Received) and event.via == via and isinstance(event.frame.message, Ping)
    ]


def test_frames_of_a_link_come_in_their_order_between_its_opening_and_its_end() -> None:
    inbox = Inbox(1)
    inbox.open("link")
    inbox.put(ping(1), "link")
    inbox.put(ping(2), "link")
    inbox.close("link")
    kinds = [type(event) for event in inbox.take()]
    assert kinds == [Opened, Received, Received, Closed]
    assert inbox.take() == []


@given(flood=st.integers(0, 3 * LARGEST_QUEUE))
def test_a_flood_is_bounded_and_what_is_dropped_is_counted(flood: int) -> None:
    inbox = Inbox(1)
    for i in range(flood):
        inbox.put(ping(i), "flooder")
    assert inbox.dropped == max(0, flood - LARGEST_QUEUE)
    heard: list[int] = []
    while turn := numbers(inbox, "flooder"):
        assert len(turn) <= CREDIT
        heard += turn
    assert heard == list(range(min(flood, LARGEST_QUEUE)))


def test_a_flood_does_not_delay_others() -> None:
    inbox = Inbox(1)
    for i in range(10_000):
        inbox.put(ping(i), "flooder")
    inbox.put(ping(7), "other")
    assert numbers(inbox, "other") == [7]


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
    inbox, heard = Inbox(1), 0
    for _ in range(200):
        for _ in range(20):
            inbox.put(frame, "flooder")
        heard += len(inbox.take())
    assert heard == pytest.approx(per_second, rel=0.03)


def test_many_flooders_share_what_there_is() -> None:
    inbox, heard = Inbox(1), 0
    for _ in range(200):
        for via in range(32):
            inbox.put(ping(1), via)
            inbox.put(ping(1), via)
            inbox.put(ping(1), via)
        heard += len(inbox.take())
    assert heard == 200 * 64


def test_a_stop_goes_before_everything_even_of_the_flooder_itself() -> None:
    inbox = Inbox(1)
    for i in range(10_000):
        inbox.put(ping(i), "flooder")
    inbox.put(STOP, "flooder")
    first = inbox.take()[0]
    assert isinstance(first, Received)
    assert first.frame is STOP


def test_a_flood_of_stops_is_bounded_and_still_a_stop() -> None:
    inbox = Inbox(1)
    for _ in range(10_000):
        inbox.put(STOP, "flooder")
    assert len(inbox.take()) == LARGEST_STOPS
    assert inbox.dropped == 10_000 - LARGEST_STOPS, "who is not answered is counted"


def test_stops_for_others_leave_a_stop_for_us_its_place() -> None:
    inbox = Inbox(1)
    for _ in range(10 * LARGEST_STOPS):
        inbox.put(Frame.of(SetMode(0, 2, 1, ModeKind.SAFE_STOP)), "relay")
        inbox.put(Frame.of(CommandLong(3, 1, MavCmd.COMPONENT_ARM_DISARM, 0, *(0.0,) * 7)), "relay")
    inbox.put(STOP, "relay")
    first = inbox.take()[0]
    assert isinstance(first, Received)
    assert first.frame is STOP
    assert inbox.dropped == 0
    assert inbox.stops == 1, "a stop for another system is none here"


def test_the_end_of_a_link_is_never_dropped() -> None:
    inbox = Inbox(1)
    for i in range(10_000):
        inbox.put(ping(i), "flooder")
    inbox.close("flooder")
    events = [event for _ in range(LARGEST_QUEUE) for event in inbox.take()]
    assert events[-1] == Closed("flooder")


def test_a_link_that_has_ended_has_one_more_turn() -> None:
    inbox = Inbox(1)
    for i in range(100):
        inbox.put(ping(i), "link")
    inbox.put(STOP, "link")
    inbox.close("link")
    inbox.put(ping(7), "other")
    events = inbox.take()
    assert isinstance(events[0], Received)
    assert events[0].frame is STOP, "a stop goes before everything, also before the end of its link"
    assert [type(event) for event in events if event.via == "link"] == [Received] * (1 + CREDIT) + [Closed]
    assert inbox.dropped == 100 - CREDIT
    assert inbox.take() == []


def test_an_arrival_keeps_its_moment_however_long_it_waits() -> None:
    inbox = Inbox(1)
    for i in range(3 * CREDIT):
        inbox.put(ping(i), "link", now=10 * i)
    heard = [event for _ in range(3) for event in inbox.take()]
    assert [event.arrived for event in heard if isinstance(event, Received)] == [
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
