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


def test_a_rover_that_is_stopped_is_not_armed(operator: Operator) -> None:
    operator.set_mode(ModeKind.SAFE_STOP)
    assert operator.hear(Heartbeat, lambda it: it.system_status == MavState.CRITICAL).base_mode == 1


def test_each_start_is_another_life(
    power: Callable[..., AbstractContextManager[int]], make_operator: type[Operator]
) -> None:
    lives: list[int] = []
    for _ in range(2):
        with power() as port, make_operator(port) as operator:
            lives.append(operator.hear(Mode).life)
    assert 0 not in lives
    assert lives[0] != lives[1]


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


@pytest.mark.parametrize(("speed", "state"), [(0.01, GoalState.ACTIVE), (0.00999, GoalState.REFUSED)])
def test_a_limit_is_met_by_the_float_that_the_wire_makes_of_it(
    operator: Operator, speed: float, state: GoalState
) -> None:
    assert operator.ask(7, FAR, 0.0, speed).state == state


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
