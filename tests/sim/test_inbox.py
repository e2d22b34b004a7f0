"""From the links to the physics: bounded, fair, stops first; what is beyond a share waits or is counted."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Endpoint, Frame, Parser
from robotree.protocol.errors import LinkClosed, LinkError
from robotree.protocol.frame import encode
from robotree.protocol.links.link import Link
from robotree.protocol.links.loopback import Loopback
from robotree.protocol.messages import (
    CommandInt,
    CommandLong,
    Goal,
    GoalState,
    GoalStatus,
    MavCmd,
    Message,
    Mode,
    ModeKind,
    Ping,
    SetMode,
    Setpoint,
    SysStatus,
    Verb,
)
from robotree.protocol.testing import until
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
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.kinds import kind
from robotree.sim.serving.throttle import (
    BURST,
    LARGEST_BACKLOG,
    LONGEST_FRAME,
    PIECE,
    Throttled,
    TokenBucket,
    stops_in,
)
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


class Listener:
    """Keeps what it hears."""

    def __init__(self) -> None:
        self.data = b""
        self.stamps: set[int | None] = set()
        self.ended = False
        self._news = asyncio.Event()

    async def until(self, amount: int) -> None:
        while len(self.data) < amount:
            self._news.clear()
            await self._news.wait()

    def received(self, data: bytes, stops: int | None) -> None:
        assert not self.ended
        assert len(data) <= PIECE
        self.data += data
        self.stamps.add(stops)
        self._news.set()

    def closed(self, _: LinkError) -> None:
        self.ended = True


def _deaf(link: Link) -> Endpoint:
    return Endpoint(link, system=1, component=1, on_frame=lambda _: None)


class Bench:
    """A throttled link that cannot be paused, whose share is nearly nothing until it is given one."""

    def __init__(self) -> None:
        self.listener, self.stops, self.lost, self.share = Listener(), 3, 0, 1.0
        self.link = Loopback(self._accept, _deaf).near

    def _accept(self, link: Link) -> Throttled:
        self.throttled = Throttled(link, self.listener, lambda: self.share, lambda: self.stops, self._lose)
        return self.throttled

    def _lose(self) -> None:
        self.lost += 1


END = LinkClosed("loop:near", by_us=False)
DATAGRAM = bytes(range(256)) * 4


async def test_every_datagram_of_a_flood_is_heard_or_counted() -> None:
    bench = Bench()
    sent = 2 * int(BURST + LARGEST_BACKLOG) // len(DATAGRAM)
    bench.share = LARGEST_BACKLOG
    for _ in range(sent):
        bench.throttled.received(DATAGRAM)
    assert bench.lost > 0
    async with asyncio.timeout(60.0):
        await bench.listener.until((sent - bench.lost) * len(DATAGRAM))
    assert len(bench.listener.data) == (sent - bench.lost) * len(DATAGRAM)


def said(message: Message) -> bytes:
    return encode(message, sequence=0, system=9, component=1)


PING = said(Ping(0, 1))
STOPS = [
    said(SetMode(0, 0, 0, ModeKind.SAFE_STOP)),
    said(CommandLong(1, 1, MavCmd.COMPONENT_ARM_DISARM, 0, *(0.0,) * 7)),
    said(CommandInt(1, 1, 0, MavCmd.DO_FLIGHTTERMINATION, 0, 0, 1.0, 0, 0, 0, 0, 0, 0)),
]
RELEASE = said(SetMode(0, 1, 1, ModeKind.READY))


@pytest.mark.parametrize("stop", STOPS, ids=["mode", "disarm", "terminate"])
@pytest.mark.parametrize("place", [0.0, 0.4, 1.0])
@given(cut=st.integers(0, len(PING)))
def test_of_what_waited_when_the_link_ended_the_stops_are_heard_and_little_else(
    stop: bytes, place: float, cut: int
) -> None:
    before = int(place * 2000)
    waited = (PING * before)[cut if before else 0 :] + stop + (PING * 200 + RELEASE) * (10 - before // 200)
    parser = Parser()
    parser.feed(PING[:cut] if before else b"")
    words = stops_in(waited, PIECE)
    assert len(words) <= PIECE
    messages = [frame.message for frame in parser.feed(words)]
    assert any(map(stop_asked_by, messages))
    assert len(messages) < 2 + LONGEST_FRAME / len(PING)


@given(st.binary(max_size=3 * LONGEST_FRAME))
def test_stops_in_anything_are_bounded_and_leave_no_frame_waiting(data: bytes) -> None:
    words = stops_in(data * 20, PIECE)
    assert len(words) <= PIECE
    parser = Parser()
    parser.feed(data)
    parser.feed(words)
    assert parser.flush() == []


async def test_a_stop_behind_the_flood_of_a_link_that_ends_is_heard_and_nothing_after_the_end() -> None:
    bench = Bench()
    bench.throttled.received(DATAGRAM * 100)
    bench.throttled.received(STOPS[0] + DATAGRAM * 100)
    told = len(bench.listener.data)
    bench.throttled.closed(END)
    assert STOPS[0] in bench.listener.data
    assert len(bench.listener.data) - told <= PIECE
    assert bench.lost == 1


async def test_a_link_that_ends_because_of_what_is_answered_is_heard_no_more() -> None:
    bench = Bench()
    heard = bench.listener.received

    def answer(data: bytes, stops: int | None) -> None:
        heard(data, stops)
        if len(bench.listener.data) == 2 * PIECE:
            bench.throttled.closed(END)

    bench.listener.received = answer  # type: ignore[method-assign]
    bench.throttled.received(DATAGRAM * 100)
    assert bench.listener.ended
    assert len(bench.listener.data) <= 3 * PIECE
    assert bench.throttled._later is None


async def test_who_begins_with_less_than_a_burst_is_heard_a_piece_at_once_and_then_at_its_share() -> None:
    bench = Bench()
    throttled = Throttled(bench.link, bench.listener, lambda: 1.0, lambda: 0, bench._lose, 0.0)
    throttled.received(DATAGRAM * 100)
    assert len(bench.listener.data) == PIECE
    throttled.closed(END)


async def test_what_waited_is_as_old_as_the_beginning_of_the_wait() -> None:
    bench = Bench()
    bench.throttled.received(DATAGRAM)
    assert bench.listener.stamps == {None}
    bench.throttled.received(DATAGRAM * 100)
    bench.stops = 9
    bench.throttled.received(DATAGRAM)
    bench.listener.stamps.clear()
    bench.throttled.closed(END)
    assert bench.listener.stamps == {3}


async def test_who_has_caught_up_is_heard_as_now_again() -> None:
    bench = Bench()
    bench.share = 10 * BURST
    bench.throttled.received(DATAGRAM * 100)
    bench.throttled.received(DATAGRAM)
    async with asyncio.timeout(60.0):
        await bench.listener.until(101 * len(DATAGRAM))
    bench.listener.stamps.clear()
    bench.throttled.received(DATAGRAM)
    await bench.listener.until(102 * len(DATAGRAM))
    assert bench.listener.stamps == {3}, "it may have waited in the system"
    await asyncio.sleep(0.2)
    bench.listener.stamps.clear()
    bench.throttled.received(DATAGRAM)
    assert bench.listener.stamps == {None}


async def test_a_release_behind_its_own_flood_does_not_undo_the_stop_of_another_link() -> None:
    controller = kind("rover").build(1, 2.0)

    class Client:
        """Bytes of a link, parsed and posted as a connection does."""

        def __init__(self) -> None:
            self.stops: int | None = None

        def received(self, data: bytes, stops: int | None) -> None:
            self.stops = stops
            endpoint.received(data)

        def closed(self, reason: LinkError) -> None:
            endpoint.closed(reason)

    def post(frame: Frame) -> None:
        controller.post(frame, "flooder", client.stops)

    client, bench = Client(), Bench()
    endpoint = Endpoint(bench.link, system=1, component=1, on_frame=post)
    throttled = Throttled(bench.link, client, lambda: BURST, lambda: controller.stops, lambda: None)
    throttled.received(bytes(int(BURST) + 8 * PIECE))
    throttled.received(encode(SetMode(0, 1, 1, ModeKind.READY), sequence=0, system=200, component=1))
    controller.post(Frame.of(SetMode(0, 1, 1, ModeKind.SAFE_STOP)), "other")
    told = [each.message for each in controller.advance() if isinstance(each.message, Mode)]
    assert {mode.mode for mode in told} == {ModeKind.SAFE_STOP}
    for _ in range(400):
        controller.advance()
    await until(lambda: endpoint.statistics.received == 1)
    for _ in range(400):
        controller.advance()
    assert controller.firmware.mode == ModeKind.SAFE_STOP


def test_what_was_lost_is_told() -> None:
    controller = kind("rover").build(1, 2.0)
    controller.greet("link")
    controller.firmware.gauges.lost = 7
    out = [each.message for _ in range(300) for each in controller.advance()]
    assert {each.errors_comm for each in out if isinstance(each, SysStatus)} == {7}


@given(
    amounts=st.lists(st.integers(1, 5000), max_size=50),
    pauses=st.lists(st.floats(0.0, 2.0), min_size=50, max_size=50),
)
def test_an_allowance_never_lets_more_through_than_burst_and_rate(
    amounts: list[int], pauses: list[float]
) -> None:
    burst, rate, now, spent = 4000.0, 1000.0, 0.0, 0
    bucket = TokenBucket(burst, now)
    for amount, pause in zip(amounts, pauses, strict=False):
        now += pause
        now += bucket.wait(rate, now)
        assert spent <= burst + rate * now + 1e-6
        bucket.spend(amount)
        spent += amount
