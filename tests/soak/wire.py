"""The wire: a recording of one robot at another one, and a plain tool after a proxy."""

from __future__ import annotations

import asyncio
import math
import random
import time
from collections.abc import Sequence

from robotree.protocol.links.keyring import create
from robotree.protocol.links.security import UNSIGNED
from robotree.protocol.links.url import connect
from robotree.protocol.messages import ClaimStatus, CommandAck, CommandLong, MavCmd, MavResult, ModeKind
from robotree.protocol.testing import RecordingHandler
from tests.scenarios.test_replay_after_a_kill import Operator
from tests.soak.observer import BEAT, holds
from tests.soak.stage import Stage
from tests.soak.table import Row, Trial
from tests.station import Station

CROSSED = Row(
    "wire",
    "frames that release one signed arm, replayed to another one of the same key file",
    "from the order to the other arm's safe stop",
    5.0,
)
PLAIN = Row(
    "wire",
    "a tool without claims commands an arm after its proxy has claimed it and was ended",
    "from the end of the proxy until a command is accepted",
    8.0,
)


async def crossed(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Record what releases one arm, and replay it to another one that is stopped."""
    key = stage.folder / "crossed.key"
    create(key)
    arms = [
        await stage.start(name, "sim", "arm", "--key", str(key), "--listen", "tcp:127.0.0.1:0")
        for name in ("one arm", "other arm")
    ]
    one, other = [await Operator(key, 40 * place).dial(arm.address) for place, arm in enumerate(arms)]
    one.arm(0.0)
    stopped = await holds(lambda: one.latest() == ModeKind.SAFE_STOP, 5.0)
    one.arm(1.0)
    released = await holds(lambda: one.latest() == ModeKind.READY, 5.0)
    other.arm(0.0)
    began = time.monotonic()
    trial = Trial(CROSSED, await holds(lambda: other.latest() == ModeKind.SAFE_STOP, 5.0))
    trial.seconds = time.monotonic() - began
    trial.reached = trial.reached and stopped and released
    attacker = await connect(arms[1].address, RecordingHandler)
    for frame in one.said:
        attacker.send(frame)
    if await holds(lambda: other.latest() != ModeKind.SAFE_STOP, 1.0):
        trial.false.append("frames that were said to one arm released the other one")
    attacker.close()
    for name in ("one arm", "other arm"):
        await stage.kill(name)
    key.unlink()
    return [trial]


async def plain(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Let a proxy claim an arm, kill it, and command the arm twice as MAVSDK does."""
    arm = await stage.start("plain arm", "sim", "arm", "--listen", "tcp:127.0.0.1:0")
    await stage.start("plain proxy", "proxy", "arm", "arm-3", "--connect", arm.address)
    tool = await Station(security=UNSIGNED).dial(arm.address)

    def results() -> list[int]:
        return [each.result for each in tool.heard if isinstance(each, CommandAck) if each.result != 5]

    def held() -> bool:
        told = [each.holder for each in tool.heard if isinstance(each, ClaimStatus)]
        return bool(told and told[-1])

    async def beat() -> None:
        while True:
            tool.say(BEAT)
            await asyncio.sleep(0.5)

    beating = asyncio.create_task(beat())
    claimed = await holds(held, 10.0)
    await asyncio.sleep(chance.uniform(0.0, 1.0))
    await stage.kill("plain proxy")
    began = time.monotonic()
    trial = Trial(PLAIN, claimed and await holds(lambda: not held(), 5.0))
    for y in (0.1, 0.0):
        before = len(results())
        place = (0.45, y, 0.35, 0.0, math.nan, math.nan, math.nan)
        tool.say(CommandLong(1, 1, MavCmd.ROBOTREE_GO_TO, 0, *place))
        answered = await holds(lambda before=before: len(results()) > before, 8.0)
        if not answered or results()[-1] != MavResult.ACCEPTED:
            trial.reached, trial.note = False, f"y = {y}: answers {results()}; {tool.sentences[-1:]}"
        trial.seconds = trial.seconds or time.monotonic() - began
    beating.cancel()
    tool.link.close()
    await stage.kill("plain arm")
    return [trial]
