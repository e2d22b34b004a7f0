"""A recording of one robot moves no other robot of the same key, and none after a restart."""

from __future__ import annotations

import math
import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path

import pytest

from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.security import Security
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    AnyMessage,
    CommandLong,
    Goal,
    MavCmd,
    MavParamType,
    Mode,
    ModeKind,
    ParamSet,
    SetMode,
    Verb,
)
from robotree.protocol.testing import RecordingHandler
from robotree.sim.serving.server import Server, serving
from robotree.vr.world.testing import until
from tests.scenarios.test_replay_after_a_kill import Operator

NOTHING = (math.nan,) * 4


def command(number: int, *values: float) -> CommandLong:
    return CommandLong(1, 1, number, 0, *values, *(0.0,) * (7 - len(values)))


ORDERS: list[AnyMessage] = [
    SetMode(0, 1, 1, ModeKind.READY),
    command(MavCmd.COMPONENT_ARM_DISARM, 1.0),
    command(MavCmd.REQUEST_OPERATOR_CONTROL, 1.0, 1.0, 10.0),
    ParamSet(1, 1, "LINK_SILENCE", 3000.0, MavParamType.REAL32),
    Goal(77, 1, 0, (0.3, 0.2, 0.4, *NOTHING), Verb.MOVE, 1, 1),
]
"""Release from a stop, in two forms; operator control; a watchdog that bears everything; a motion."""


@pytest.fixture
def key(tmp_path: Path) -> Path:
    create(tmp_path / "cell.key")
    return tmp_path / "cell.key"


@asynccontextmanager
async def controllers(key: Path, count: int) -> AsyncIterator[list[Server]]:
    """Controllers that have one key, as those of one realm do; all are stopped."""
    async with AsyncExitStack() as stack:
        servers = list[Server]()
        for number in range(count):
            security = Security(Keyring(key), time.time, first_link=10 * number)
            servers.append(
                await stack.enter_async_context(serving("rover", "tcp:127.0.0.1:0", security=security))
            )
        yield servers


def state(server: Server) -> tuple[object, ...]:
    """What somebody who commands a controller can have changed."""
    firmware = server._controller.firmware
    return (
        firmware.mode,
        firmware._rights.control.owner,
        firmware._rights.claims.fence.epoch,
        firmware._parameters._server["LINK_SILENCE"],
    )


async def test_a_recording_of_one_robot_does_nothing_at_another_one(key: Path) -> None:
    async with controllers(key, 2) as (one, other):
        for number, server in enumerate((one, other)):
            stopper = await Operator(key, 100 + number).dial(server.address)
            stopper.arm(0.0)
            await until(lambda stopper=stopper: stopper.latest() == ModeKind.SAFE_STOP, "it is stopped")
        operator = await Operator(key, 150).dial(one.address)
        for order in ORDERS:
            operator.say(order)
        await until(lambda: operator.latest() == ModeKind.ACTIVE, "it obeys who has the key, and moves")
        before = state(other)
        attacker = await connect(other.address, RecordingHandler)
        for frame in operator.said:
            attacker.send(frame)
        witness = await Operator(key, 200).dial(other.address)
        await until(lambda: any(each.garbled for each in other._connections.values()), "all were refused")
        await until(lambda: any(isinstance(each, Mode) for each in witness.heard), "it says how it is")
        assert state(other) == before
        assert before[0] == ModeKind.SAFE_STOP
        assert sum(each.garbled for each in other._connections.values()) == len(operator.said)
        attacker.close()
