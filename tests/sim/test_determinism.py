"""Two runs are the same to the last bit; time on the wire begins anew after 49.7 days, and nothing else."""

from __future__ import annotations

import hashlib
import inspect
import os
import sys

import pytest

from robotree.protocol.messages import (
    GoalState,
    Heartbeat,
    Joints,
    LocalPositionNed,
    MavCmd,
    Message,
    Mode,
    ModeKind,
    NamedValueFloat,
    SystemTime,
    Tool,
    Verb,
)
from robotree.sim.testing import ArmBench, Bench, RoverBench
from tests.command_line import ran


def played() -> str:
    arm = ArmBench()
    arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.321, 1.57)
    arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.221, 1.57, 0.05)
    arm.operator.do(Verb.GRIP, 0.0)
    arm.operator.do(Verb.GO_TO, 0.35, 0.10, 0.25, 1.57)
    return hashlib.sha256(arm.world.cell.published.tobytes()).hexdigest()


def test_runs_in_two_processes_are_the_same_to_the_last_bit() -> None:
    """With another seed of hashes, other threads of numpy, and a world that was here before."""
    ArmBench().operator.do(Verb.GRIP, 0.0)
    source = f"{inspect.getsource(sys.modules[__name__])}\nprint(played())"
    environment = {**os.environ, "PYTHONHASHSEED": "1", "OMP_NUM_THREADS": "1"}
    done = ran([sys.executable, "-c", source], check=True, env=environment)
    assert done.stdout.strip() == played()


TURN = 2**32
"""[ms]"""


def age(bench: Bench, milliseconds: int) -> None:  # type: ignore[type-arg]
    """Let the controller have been up for so long."""
    cell = bench.controller.cell
    cell._steps = round(milliseconds / 1000 / cell.model.opt.timestep)


@pytest.mark.parametrize(
    ("bench", "kinds"),
    [(ArmBench, (Joints, Tool, NamedValueFloat, Mode)), (RoverBench, (LocalPositionNed, Mode))],
)
def test_telemetry_goes_on_when_the_time_on_the_wire_begins_anew(
    bench: type[ArmBench | RoverBench], kinds: tuple[type[Message], ...]
) -> None:
    robot = bench()
    age(robot, TURN - 1000)
    for _ in range(2):
        robot.operator.heard.clear()
        robot.operator.wait(1.0)
        for kind in (*kinds, Heartbeat):
            assert robot.operator.all(kind), kind
    assert robot.operator.latest(Mode).time_boot_ms < 1100


def test_what_is_asked_for_then_is_told() -> None:
    rover = RoverBench()
    age(rover, TURN + 500)
    assert rover.operator.do(Verb.MOVE, 0.01, 0.0).state == GoalState.SUCCEEDED
    rover.operator.set_mode(ModeKind.SAFE_STOP)
    rover.operator.command(MavCmd.REQUEST_MESSAGE, SystemTime.codec.definition.id)
    rover.operator.wait(0.1)
    assert rover.operator.mode()[0] == ModeKind.SAFE_STOP
    assert 500 <= rover.operator.latest(SystemTime).time_boot_ms < 60_000
    late = rover.operator.another()
    late.wait(0.1)
    assert late.latest(Mode).time_boot_ms < 60_000
