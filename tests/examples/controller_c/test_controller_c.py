"""What the controller in C says on the wire, held against the rules of the simulated controller."""

from __future__ import annotations

import math
import random
import re
import socket
import subprocess
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    AnyMessage,
    Claim,
    ClaimStatus,
    ClaimWish,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    Heartbeat,
    MavAutopilot,
    MavState,
    MavType,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.protocol.parser import Parser
from robotree.protocol.services.fence import LAST_EPOCH, Fence
from robotree.protocol.testing import random_values
from robotree.sim.firmware import Firmware, Identity
from robotree.sim.rover import world

Operator = Any
LIFE = Heartbeat(MavType.ONBOARD_CONTROLLER, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
SOURCE = Path(__file__).parents[3] / "examples" / "controller_c"
LIFE_NOW = 1
"""Stands for the life that a controller tells."""
FAR, SLOW = 1.4, 0.02
"""[m], [m/s] A move that no test waits for."""


def test_it_says_at_once_who_it_is_and_how(operator: Operator) -> None:
    heartbeat, mode = operator.next(), operator.next()
    assert isinstance(heartbeat, Heartbeat)
    assert heartbeat.type == MavType.GROUND_ROVER
    assert isinstance(mode, Mode)
    assert (mode.mode, mode.epoch, mode.silence_ms) == (ModeKind.READY, 0, 2000)


def test_its_kind_of_vehicle_stands_in_the_robots_file_and_not_in_the_rules() -> None:
    rules, robot = (
        re.sub(r"/\*.*?\*/", "", (SOURCE / name).read_text(), flags=re.DOTALL)
        for name in ("rules.h", "controller.c")
    )
    assert "MAV_TYPE_" not in rules
    assert "#define ROBOT_TYPE MAV_TYPE_GROUND_ROVER" in robot


def test_a_move_is_active_then_reached_at_the_speed_asked_for(operator: Operator) -> None:
    began = time.monotonic()
    assert operator.ask(7, 0.3, -0.4, 1.0).state == GoalState.ACTIVE
    status = operator.status(7, GoalState.SUCCEEDED)
    assert time.monotonic() - began > 0.45, "half a metre at 1 m/s"
    assert (status.progress, status.reason) == (1.0, Reason.NONE)
    assert operator.place() == pytest.approx((0.3, -0.4), abs=1e-6)


def test_the_same_key_replays_the_status_and_does_not_move_twice(operator: Operator) -> None:
    operator.ask(7, 0.1, 0.0, 1.0)
    first = operator.status(7, GoalState.SUCCEEDED)
    assert operator.ask(7, 0.1, 0.0, 1.0, epoch=3, ttl=9000) == GoalStatus(
        7, 3, 1.0, first.sequence, 0, 255, 190, GoalState.SUCCEEDED, ""
    )
    other = operator.ask(7, 0.2, 0.0, 1.0)
    assert (other.state, other.reason) == (GoalState.REFUSED, Reason.KEY_REUSED)
    assert operator.place() == pytest.approx((0.1, 0.0), abs=1e-6)


def test_another_sender_has_keys_of_its_own(
    port: int, operator: Operator, make_operator: type[Operator]
) -> None:
    operator.ask(7, FAR, 0.0, SLOW)
    with make_operator(port, system=254) as other:
        assert other.ask(7, verb=Verb.STATUS).state == GoalState.UNKNOWN
        assert other.ask(7, 0.0, 0.1, SLOW).state == GoalState.ACTIVE
    assert operator.status(7, GoalState.CANCELLED).reason == Reason.SUPERSEDED


@pytest.mark.parametrize(
    ("verb", "args", "reason"),
    [
        (Verb.MOVE, (1.6, 0.0), Reason.OUT_OF_REACH),
        (Verb.MOVE, (0.0, 1e30), Reason.OUT_OF_REACH),
        (Verb.MOVE, (math.nan, 0.0), Reason.BAD_ARGUMENT),
        (Verb.MOVE, (0.1, -math.inf), Reason.BAD_ARGUMENT),
        (Verb.MOVE, (0.1, 0.0, 0.0), Reason.BAD_ARGUMENT),
        (Verb.MOVE, (0.1, 0.0, math.inf), Reason.BAD_ARGUMENT),
        (Verb.GRIP, (0.02,), Reason.UNKNOWN_VERB),
        (777, (), Reason.UNKNOWN_VERB),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_sentence(
    operator: Operator, verb: int, args: tuple[float, ...], reason: Reason
) -> None:
    status = operator.ask(7, *args, verb=verb)
    assert (status.state, status.reason) == (GoalState.REFUSED, reason)
    assert status.text.endswith(".")
    assert operator.place() == (0.0, 0.0)


def test_a_hold_ends_what_runs(operator: Operator) -> None:
    operator.ask(7, FAR, 0.0, SLOW)
    operator.say(Goal(8, 1, 0, (math.nan,) * 7, Verb.HOLD, 1, 1))
    assert operator.status(7, GoalState.CANCELLED).reason == Reason.SUPERSEDED
    assert operator.status(8, GoalState.SUCCEEDED).progress == 1.0


def test_a_stop_is_obeyed_under_any_epoch_and_released_only_under_one_that_is_not_stale(
    operator: Operator,
) -> None:
    operator.ask(7, FAR, 0.0, SLOW, epoch=5)
    assert operator.set_mode(ModeKind.SAFE_STOP, epoch=0).mode == ModeKind.SAFE_STOP
    assert operator.ask(7, verb=Verb.STATUS).reason == Reason.STOPPED
    assert operator.ask(8, 0.1, 0.0, epoch=5).reason == Reason.STOPPED
    assert operator.set_mode(ModeKind.READY, epoch=4).reason == Reason.STALE_EPOCH
    assert operator.set_mode(ModeKind.FAULT, epoch=5).reason == Reason.BAD_ARGUMENT
    assert operator.hear(Heartbeat).base_mode == 1
    operator.set_mode(ModeKind.READY, epoch=5)
    assert operator.ask(9, 0.1, 0.0, epoch=5).state == GoalState.ACTIVE


def test_a_release_ends_no_stop_that_began_after_the_one_it_names(operator: Operator) -> None:
    release = SetMode(1, 1, 1, ModeKind.READY, operator.set_mode(ModeKind.SAFE_STOP).stops)
    operator.say(release)
    operator.hear(Mode, lambda it: it.mode == ModeKind.READY)
    operator.say(release)
    assert operator.set_mode(ModeKind.SAFE_STOP).stops == release.stops + 1
    operator.say(release)
    operator.hear(Mode, lambda it: it.reason == Reason.STOPPED)
    assert operator.ask(7, 0.1, 0.0).reason == Reason.STOPPED
    operator.say(SetMode(1, 1, 1, ModeKind.READY, release.stops + 1))
    assert operator.ask(8, 0.1, 0.0).state == GoalState.ACTIVE


def test_a_goal_that_is_not_reached_in_time_expires(operator: Operator) -> None:
    began = time.monotonic()
    operator.ask(7, FAR, 0.0, SLOW, ttl=300)
    operator.status(7, GoalState.EXPIRED)
    assert time.monotonic() - began > 0.25
    standing = operator.place()
    assert operator.place() == standing


def test_a_link_that_ends_takes_the_movement_of_its_commander_with_it_and_no_other(
    port: int, make_operator: type[Operator]
) -> None:
    with make_operator(port, system=254) as listener:
        with make_operator(port) as operator:
            operator.ask(7, FAR, 0.0, SLOW)
            with make_operator(port, system=253) as passer_by:
                passer_by.say(LIFE)
            operator.place()
            assert operator.ask(7, verb=Verb.STATUS).state == GoalState.ACTIVE, "another link has ended"
        began = time.monotonic()
        mode = listener.hear(Mode, lambda it: it.mode == ModeKind.HOLD)
        assert mode.reason == Reason.LINK_SILENT
        assert time.monotonic() - began < 1.0, "not only when the silence was too long"
        with make_operator(port) as back:
            assert back.ask(7, verb=Verb.STATUS).reason == Reason.LINK_SILENT
            assert back.ask(8, FAR, 0.0, SLOW).state == GoalState.ACTIVE, "it may ask again"


def test_a_movement_goes_on_when_its_commander_has_asked_for_it_on_another_link_before(
    port: int, make_operator: type[Operator]
) -> None:
    with make_operator(port) as back:
        with make_operator(port) as operator:
            operator.ask(7, FAR, 0.0, SLOW)
            assert back.ask(7, verb=Verb.STATUS).state == GoalState.ACTIVE
        back.place()
        assert back.ask(7, verb=Verb.STATUS).state == GoalState.ACTIVE


@pytest.mark.parametrize(("speed", "state"), [(0.01, GoalState.ACTIVE), (0.00999, GoalState.REFUSED)])
def test_a_limit_is_met_by_the_float_that_the_wire_makes_of_it(
    operator: Operator, speed: float, state: GoalState
) -> None:
    assert operator.ask(7, FAR, 0.0, speed).state == state


def test_a_silent_sender_loses_its_movement_whoever_else_speaks(
    port: int, operator: Operator, make_operator: type[Operator]
) -> None:
    began = time.monotonic()
    operator.ask(7, FAR, 0.0, SLOW)
    with make_operator(port, system=254) as logger:
        while (mode := logger.hear(Mode)).mode == ModeKind.ACTIVE:
            logger.say(LIFE)
        assert time.monotonic() - began > 1.9
        assert (mode.mode, mode.reason) == (ModeKind.HOLD, Reason.LINK_SILENT)
    assert operator.status(7, GoalState.CANCELLED).reason == Reason.LINK_SILENT
    assert operator.ask(8, 0.1, 0.0).state == GoalState.ACTIVE


def claim(operator: Operator, holder: int, epoch: int = 1, wish: int = ClaimWish.KEEP) -> ClaimStatus:
    """Claim it, under a term that no test waits for; the answer."""
    operator.say(Claim(holder, epoch, 9000, 0, 1, 1, wish, f"holder {holder}"))
    answer: ClaimStatus = operator.hear(ClaimStatus, lambda it: it.target_system == operator.system)
    return answer


def test_under_a_claim_the_holder_must_be_heard_and_not_a_namesake_with_its_ids(
    operator: Operator,
) -> None:
    assert claim(operator, 5).holder == 5
    began = time.monotonic()
    operator.ask(7, FAR, 0.0, SLOW)
    for _ in range(5):
        time.sleep(0.25)
        claim(operator, 5)
    assert operator.ask(7, verb=Verb.STATUS).state == GoalState.ACTIVE
    while (mode := operator.hear(Mode)).mode == ModeKind.ACTIVE:
        operator.say(LIFE)  # as QGroundControl's heartbeat behind the same router
    assert 3.0 < time.monotonic() - began < 5.0
    assert (mode.mode, mode.reason) == (ModeKind.HOLD, Reason.LINK_SILENT)


def test_a_second_holder_is_refused_and_nothing_of_it_obeyed_until_it_takes_over(
    port: int, operator: Operator, make_operator: type[Operator]
) -> None:
    claim(operator, 5)
    operator.ask(7, FAR, 0.0, SLOW)
    with make_operator(port, system=254) as other:
        answer = claim(other, 6, epoch=9)
        assert (answer.holder, answer.reason, answer.name) == (5, Reason.NOT_IN_CONTROL, "holder 5")
        refused = other.ask(8, 0.1, 0.0, epoch=9)
        assert (refused.state, refused.reason, refused.epoch) == (
            GoalState.REFUSED,
            Reason.NOT_IN_CONTROL,
            1,
        )
        assert other.set_mode(ModeKind.SAFE_STOP, epoch=0).mode == ModeKind.SAFE_STOP, "stops are everyone's"
        other.say(SetMode(9, 1, 1, ModeKind.READY))
        mode = other.hear(Mode, lambda it: it.reason == Reason.NOT_IN_CONTROL)
        assert mode.mode == ModeKind.SAFE_STOP
        operator.say(SetMode(1, 1, 1, ModeKind.READY))
        operator.hear(Mode, lambda it: it.mode == ModeKind.READY)
        operator.ask(9, FAR, 0.0, SLOW)
        assert claim(other, 6, epoch=1, wish=ClaimWish.TAKE_OVER).reason == Reason.STALE_EPOCH
        assert claim(other, 6, epoch=2, wish=ClaimWish.TAKE_OVER).holder == 6
        assert operator.status(9, GoalState.CANCELLED).reason == Reason.NOT_IN_CONTROL
        assert operator.ask(10, 0.1, 0.0, epoch=3).reason == Reason.NOT_IN_CONTROL
        assert other.ask(8, 0.1, 0.0, epoch=2).state == GoalState.ACTIVE


def test_no_frame_with_an_epoch_near_the_end_shuts_out_who_comes_after_it(operator: Operator) -> None:
    for epoch in (2**32 - 1, LAST_EPOCH, int(time.time()) + 10**8):
        assert operator.ask(7, 0.1, 0.0, epoch=epoch).reason == Reason.BAD_EPOCH
        assert operator.cancel(0, epoch=epoch).reason == Reason.BAD_EPOCH
        assert operator.set_mode(ModeKind.READY, epoch=epoch).reason == Reason.BAD_EPOCH
        assert claim(operator, 5, epoch=epoch).reason == Reason.BAD_EPOCH
    assert operator.ask(8, 0.1, 0.0, epoch=1).state == GoalState.ACTIVE


def test_a_goal_made_for_another_life_does_not_begin(
    power: Callable[..., AbstractContextManager[int]], make_operator: type[Operator]
) -> None:
    with power() as port, make_operator(port) as operator:
        before = operator.hear(Mode).life
    with power() as port, make_operator(port) as operator:
        after = operator.hear(Mode).life
        assert 0 not in {before, after}
        other = after % 0xFFFF + 1
        operator.say(Goal(7, 1, 0, (0.1, 0.0, *(math.nan,) * 5), Verb.MOVE, 1, 1, other))
        status = operator.status(7)
        assert (status.state, status.reason) == (GoalState.UNKNOWN, Reason.OTHER_LIFE)
        operator.say(Goal(7, 1, 0, (0.1, 0.0, *(math.nan,) * 5), Verb.MOVE, 1, 1, after))
        assert operator.status(7).state == GoalState.ACTIVE


@pytest.mark.parametrize("seed", range(4))
def test_its_rules_are_those_of_the_simulated_controller(
    port: int, seed: int, make_operator: type[Operator]
) -> None:
    """Seeded messages to both; then both must say the same of every key."""
    chance = random.Random(seed)
    identity = Identity(life=LIFE_NOW, wall=time.time)
    fence = Fence(clock=time.time)
    firmware = Firmware(
        world.build().rover, (), system=1, mav_type=MavType.GROUND_ROVER, identity=identity, fence=fence
    )
    parser, keys = Parser(), (0, 1, 2, 3, 4)

    def reference(message: AnyMessage) -> list[AnyMessage]:
        (frame,) = parser.feed(encode(message, sequence=0, system=255, component=190))
        return [each.message for each in firmware.receive(frame, "wire", 0)]

    def polled(key: int) -> Goal:
        return Goal(key, 0, 0, (0.0,) * 7, Verb.STATUS, 1, 1)

    with make_operator(port) as operator:
        life = operator.hear(Mode).life
        for barrier in range(1000, 1100):
            message = _anything(chance, keys)
            reference(message)
            if getattr(message, "life", 0) == LIFE_NOW:
                message = msgspec.structs.replace(message, life=life)
            operator.say(message)
            answers = [each for key in keys for each in reference(polled(key))]
            want = [_gist(each) for each in answers if isinstance(each, GoalStatus)]
            for key in (*keys, barrier):
                operator.say(polled(key))
            told: dict[int, Any] = {}
            operator.hear(GoalStatus, lambda it, told=told: told.update({it.key: _gist(it)}) or it.key > 999)
            assert [told[key] for key in keys] == want, message


def _gist(status: GoalStatus) -> tuple[int, ...]:
    return status.key, status.state, status.reason, status.epoch


def _anything(chance: random.Random, keys: tuple[int, ...]) -> AnyMessage:
    key, epoch = chance.choice(keys), chance.choice((1, 1, 1, 2, 2, 3, 3, 4, 2**32 - 1, LAST_EPOCH))
    life = chance.choice((0, 0, LIFE_NOW, LIFE_NOW, 9))
    match chance.randrange(10):
        case 0:
            return GoalCancel(key, epoch, 1, 1, life)
        case 1:
            mode = chance.choice((ModeKind.SAFE_STOP, ModeKind.READY, ModeKind.READY))
            return SetMode(epoch, 1, 1, mode, chance.randrange(4), life)
        case 2:
            wish = chance.choice((*ClaimWish, ClaimWish.KEEP, 0))
            return Claim(
                chance.choice((0, 5, 5, 6)), epoch, 9000, life, 1, 1, wish, "x" * chance.randrange(25)
            )
        case _:
            args = (chance.choice((FAR, 0.5, math.nan)), 0.0, SLOW, *(math.nan,) * 4)
            ttl, component = chance.choice((0, 60_000)), chance.choice((0, 1, 2))
            return Goal(key, epoch, ttl, args, Verb.MOVE, 1, component, life)


def test_random_and_torn_bytes_change_nothing(
    port: int, operator: Operator, make_operator: type[Operator]
) -> None:
    chance = random.Random(1)
    frame = encode(
        Goal(7, 1, 0, (FAR, 0.0, SLOW, *(math.nan,) * 4), Verb.MOVE, 1, 1),
        sequence=0,
        system=255,
        component=190,
    )
    with make_operator(port, system=254) as noise:
        for _ in range(200):
            noise.socket.sendall(chance.randbytes(500))
            torn = bytearray(frame[: chance.randint(1, len(frame))])
            torn[-1] ^= chance.randrange(1, 256)
            noise.socket.sendall(bytes(torn))
            noise.socket.sendall(b"\xfd" + chance.randbytes(chance.randint(0, 300)))
    assert operator.ask(7, verb=Verb.STATUS).state == GoalState.UNKNOWN
    for byte in frame:
        operator.socket.sendall(bytes((byte,)))
    assert operator.status(7).state == GoalState.ACTIVE


def test_intact_frames_with_senseless_fields_break_nothing(
    port: int, operator: Operator, make_operator: type[Operator]
) -> None:
    chance = random.Random(2)
    with make_operator(port, system=254) as fool:
        for kind in chance.choices((Goal, GoalCancel, SetMode, Heartbeat), k=400):
            values = random_values(kind.codec.definition, chance)
            values |= {name: 1 for name in ("target_system", "target_component") if name in values}
            fool.say(kind.codec.build(*values.values()))
        epoch = fool.hear(Mode).epoch
        fool.say(SetMode(epoch, 1, 1, ModeKind.READY))
        assert fool.ask(11, verb=Verb.HOLD, epoch=epoch).state == GoalState.ACTIVE
    assert all(math.isfinite(each) and abs(each) <= 1.5 for each in operator.place())


def test_more_goals_than_it_can_keep_leave_the_running_one_alone(operator: Operator) -> None:
    operator.ask(7, FAR, 0.0, SLOW)
    for key in range(1000, 1600):
        operator.say(Goal(key, 1, 0, (math.nan,) * 7, Verb.MOVE, 1, 1))
    assert operator.status(1599).reason == Reason.BAD_ARGUMENT
    assert operator.ask(7, verb=Verb.STATUS).state == GoalState.ACTIVE


def test_a_flood_of_cancels_makes_no_finished_goal_begin_again(
    port: int, operator: Operator, make_operator: type[Operator]
) -> None:
    operator.ask(7, 0.1, 0.0, 1.0)
    operator.status(7, GoalState.SUCCEEDED)
    with make_operator(port, system=254) as stranger:
        for key in range(1000, 1400):
            stranger.say(GoalCancel(key, 0, 1, 1))
        assert stranger.status(1399).state == GoalState.UNKNOWN
    assert operator.ask(7, 0.1, 0.0, 1.0).state == GoalState.SUCCEEDED, "it is remembered, not begun again"


def test_a_crowd_does_not_keep_the_newest_out(port: int, make_operator: type[Operator]) -> None:
    with (
        make_operator(port),
        make_operator(port),
        make_operator(port),
        make_operator(port),
        make_operator(port, system=254) as newest,
    ):
        assert newest.ask(1, 0.1, 0.0).state == GoalState.ACTIVE


def test_a_reader_who_never_reads_is_hung_up_on(port: int, operator: Operator) -> None:
    with socket.create_connection(("127.0.0.1", port)) as lazy:
        lazy.settimeout(30.0)
        for _ in range(60):
            for _ in range(1000):
                operator.say(Goal(1, 1, 0, (math.nan,) * 7, Verb.STATUS, 1, 1))
            operator.ask(2, verb=Verb.STATUS)
        try:
            while rest := lazy.recv(1 << 20):
                pass  # until its end; without one, the socket's timeout fails the test
        except ConnectionError:
            rest = b""
        assert not rest, "it is hung up on"


@pytest.mark.parametrize("words", [[], ["x"], ["-1"], ["65536"], ["1", "2"], [""]])
def test_a_wrong_command_line_is_answered_with_the_right_one(program: Path, words: list[str]) -> None:
    done = subprocess.run([program, *words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.split()[0]) == (2, "usage:")
