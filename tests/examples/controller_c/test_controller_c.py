"""What the controller in C says on the wire, held against the rules of the simulated controller."""

from __future__ import annotations

import math
import random
import re
import socket
import subprocess
import time
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
    MavState,
    MavType,
    Mode,
    ModeKind,
    SetMode,
    Verb,
)
from robotree.protocol.parser import Parser
from robotree.protocol.services.fence import LAST_EPOCH, Fence
from robotree.protocol.testing import random_values
from robotree.sim.firmware import Firmware, Identity
from robotree.sim.rover import world

Operator = Any
SOURCE = Path(__file__).parents[3] / "examples" / "controller_c"
LIFE_NOW = 1
"""Stands for the life that a controller tells."""
FAR, SLOW = 1.4, 0.02
"""[m], [m/s] A move that no test waits for."""


def test_a_rover_that_is_stopped_is_not_armed(operator: Operator) -> None:
    operator.set_mode(ModeKind.SAFE_STOP)
    assert operator.hear(Heartbeat, lambda it: it.system_status == MavState.CRITICAL).base_mode == 1


def test_its_kind_of_vehicle_stands_in_the_robots_file_and_not_in_the_rules() -> None:
    rules, robot = (
        re.sub(r"/\*.*?\*/", "", (SOURCE / name).read_text(), flags=re.DOTALL)
        for name in ("rules.h", "controller.c")
    )
    assert "MAV_TYPE_" not in rules
    assert "#define ROBOT_TYPE MAV_TYPE_GROUND_ROVER" in robot


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
