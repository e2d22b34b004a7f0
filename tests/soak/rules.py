"""Rules: who may command, what is carried out once, and frames that must change nothing."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

from robotree.protocol import Parser
from robotree.protocol.links.keyring import create
from robotree.protocol.links.security import UNSIGNED
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    ClaimStatus,
    CommandAck,
    CommandLong,
    Goal,
    GoalStatus,
    MavCmd,
    MavResult,
    ModeKind,
    SetMode,
    Verb,
)
from robotree.protocol.testing import RecordingHandler
from robotree.vr.base.errors import VrError
from tests.scenarios.test_keys import Operator
from tests.soak.stage import ARM, Observer, Stage, holds
from tests.soak.table import Row, Trial
from tests.station import BEAT, Station

FOREIGN = Row(
    "rule",
    "the proxy of an arm on UDP is killed; a ground station sends heartbeats with the same id (255/190)",
    "from the kill until the arm stands",
    2.5,
)
SECOND = Row(
    "rule",
    "a second proxy gets no robot while the first one lives",
    "the next call through the first one",
    5.0,
)
ONCE = Row(
    "rule",
    "a move whose result is lost, controller restarted: carried out once, or reported as in doubt",
    "",
    None,
)
REPLAY = Row(
    "rule",
    "signed controller after a crash: obeys the key, ignores a recording",
    "from the order to the safe stop",
    5.0,
)
EPOCH = Row("rule", "after frames with epochs near 2^32 the robot still takes commands", "the next call", 5.0)


@asynccontextmanager
async def _beating(station: Station, period: float) -> AsyncIterator[None]:
    """Have a ground station send heartbeats, each some time [s] after the other."""

    async def beat() -> None:
        while True:
            station.say(BEAT)
            await asyncio.sleep(period)

    beating = asyncio.create_task(beat())
    try:
        yield
    finally:
        beating.cancel()
        station.link.close()


async def foreign_heartbeat(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Kill the proxy of an arm on UDP while another program sends heartbeats with its id."""
    async with stage.another_arm("arm-2", listens="udp:127.0.0.1:0") as observer:
        station = await Station(greets=False).dial(observer.address)
        async with _beating(station, 0.2):
            goal = {"x": 0.45, "y": 0.3, "z": 0.35, "twist": 0.0, "speed": 0.05}
            call = asyncio.ensure_future(stage.realm_client.call("arm-2", "go_to", goal, deadline=20))
            moved = await observer.moves()
            await asyncio.sleep(chance.uniform(0.2, 0.8))
            mark = observer.mark()
            await stage.kill("arm-2 proxy")
            trial = Trial(FOREIGN, moved and await observer.stands(8.0))
            trial.seconds = observer.stood_after(mark)
            trial.note = "" if trial.reached else "the arm did not move" if not moved else "it drives on"
            if trial.reached and observer.place[1] > 0.28:
                trial.false.append("it drove to the end of the movement")
            call.cancel()
            await asyncio.gather(call, return_exceptions=True)
    return [trial]


async def second_proxy(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Start a second proxy for the arm's controller and command through it; then through the first one."""
    await stage.furnish()
    trial = Trial(SECOND, True)
    intruder = await stage.verb("proxy", "arm", "intruder", "--connect", stage.arm.address)
    try:
        call, _ = await stage.move_arm(speed=0.05)
        await stage.arm.moves()
        await holds(lambda: intruder.over, 2.0)
        over = {"x": 0.5, "y": 0.0, "z": 0.4, "twist": 0.0}
        with contextlib.suppress(VrError):
            await stage.realm_client.call("intruder", "go_to", over, deadline=6)
            trial.false.append("a second proxy commanded a robot whose first one lives")
        await stage.realm_client.cancel(ARM)
        await call.end()
        began = time.monotonic()
        said = await stage.send(ARM, 0.1)
        trial.reached, trial.seconds = said.done, time.monotonic() - began
        trial.note = "" if said.done else str(said)
    finally:
        intruder.kill()
    return [trial]


class Relay:
    """A line between a proxy and its controller that can lose the frames which tell that a goal has ended."""

    def __init__(self, far: str) -> None:
        host, _, port = far.removeprefix("tcp:").rpartition(":")
        self._far = (host, int(port))
        self.losing = False
        self.lost = 0
        self._tasks = set[asyncio.Task[None]]()

    @asynccontextmanager
    async def listening(self) -> AsyncIterator[str]:
        """Listen. Yields: its address."""
        server = await asyncio.start_server(self._join, "127.0.0.1", 0)
        try:
            yield f"tcp:127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            server.close()
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _join(self, near: asyncio.StreamReader, to_near: asyncio.StreamWriter) -> None:
        try:
            far, to_far = await asyncio.open_connection(*self._far)
        except OSError:
            to_near.close()
            return
        for work in (self._carry(near, to_far, answers=False), self._carry(far, to_near, answers=True)):
            task = asyncio.ensure_future(work)
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, answers: bool
    ) -> None:
        parser = Parser()
        try:
            while data := await reader.read(65536):
                if not answers:
                    writer.write(data)
                    continue
                for frame in parser.feed(data):
                    if self.losing and isinstance(frame.message, GoalStatus):
                        self.lost += 1
                    else:
                        writer.write(bytes(frame.raw))
        except OSError:
            pass
        finally:
            writer.close()


async def lost_result(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Lose all goal states of a relative move, and restart its controller in the middle or after it."""
    trial = Trial(ONCE, True)
    rover = await stage.start("far rover", "sim", "rover", "--listen", "tcp:127.0.0.1:0")
    stage.comes_back_at("far rover", rover.address)
    relay = Relay(rover.address)
    async with relay.listening() as address:
        await stage.start("far proxy", "proxy", "rover", "rover-2", "--connect", address)
        async with Observer(rover.address, 79) as observer:
            await holds(lambda: observer.fresh, 5.0)
            relay.losing = True
            verb = await stage.verb("call", "rover-2.move", "x=0.4", "y=0", "--within", "15 s")
            moved = await observer.moves()
            await asyncio.sleep(chance.uniform(0.0, 1.5))
            first = observer.place[0]
            await stage.kill("far rover")
            relay.losing = False
            await stage.restart("far rover")
            said = await verb.end()
            await observer.stands(5.0)
            again = observer.place[0]  # a controller begins its life in the middle of its floor
            trial.reached = moved and said.code is not None
            trial.note = "" if trial.reached else str(said)
            if again > 0.02 and first > 0.02:
                trial.false.append(f"it moved {first:.2f} m, and in its next life {again:.2f} m; {said}")
            if said.done and abs(first - 0.4) > 0.03:
                trial.false.append(f"{said}; but it moved {first:.2f} m and then {again:.2f} m")
    await stage.kill("far proxy")
    await stage.kill("far rover")
    return [trial]


async def replay(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Record the frames that release a signed arm, kill its controller, and replay them to the next one."""
    key = stage.folder / "replay.key"
    create(key)
    words = ("sim", "arm", "--key", str(key), "--listen")
    arm = await stage.start("signed arm", *words, "tcp:127.0.0.1:0")
    stage.comes_back_at("signed arm", arm.address)
    operator = await Operator(key, 1).dial(arm.address)
    released = await _stopped_and_released(operator)
    await stage.kill("signed arm")
    await stage.restart("signed arm")
    witness = await Operator(key, 100).dial(arm.address)
    await holds(lambda: witness.latest() == ModeKind.READY, 10.0)
    trial = await _replayed(REPLAY, operator, witness, arm.address)
    trial.reached = trial.reached and released
    await stage.kill("signed arm")
    key.unlink()
    return [trial]


async def _stopped_and_released(operator: Operator) -> bool:
    """Stop a signed arm, and release it; whether it did both."""
    operator.arm(0.0)
    stopped = await holds(lambda: operator.latest() == ModeKind.SAFE_STOP, 5.0)
    operator.arm(1.0)
    return stopped and await holds(lambda: operator.latest() == ModeKind.READY, 5.0)


async def _replayed(row: Row, said: Operator, witness: Operator, address: str) -> Trial:
    """Stop the arm of a witness, and replay to it what was said to another one, or in another life."""
    witness.arm(0.0)
    began = time.monotonic()
    trial = Trial(row, await holds(lambda: witness.latest() == ModeKind.SAFE_STOP, 5.0))
    trial.seconds = time.monotonic() - began
    attacker = await connect(address, RecordingHandler)
    for frame in said.said:
        attacker.send(frame)
    if await holds(lambda: witness.latest() != ModeKind.SAFE_STOP, 1.0):
        trial.false.append("the recorded frames have released it")
    attacker.close()
    return trial


async def great_epochs(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Send frames with epochs far ahead of any clock, then command the robot as usual."""
    await stage.furnish()
    station = await Station(greets=False).dial(stage.arm.address)
    epoch = 2**32 - 1 - chance.randrange(3)
    nothing = (math.nan,) * 7
    for message in (
        Goal(
            chance.getrandbits(63),
            epoch,
            0,
            (0.45, 0.0, 0.35, 0.0, 0.1, math.nan, math.nan),
            Verb.GO_TO,
            1,
            1,
        ),
        SetMode(epoch, 1, 1, ModeKind.SAFE_STOP),
        Goal(chance.getrandbits(63), epoch, 0, nothing, Verb.HOLD, 1, 1),
    ):
        station.say(message)
        await asyncio.sleep(0.2)
    station.link.close()
    await asyncio.sleep(0.5)
    with contextlib.suppress(VrError):
        await stage.realm_client.resume(None)
    began = time.monotonic()
    said = await stage.send(ARM, 0.05)
    trial = Trial(EPOCH, said.done, time.monotonic() - began, note="" if said.done else str(said))
    if not said.done:  # so that the trials after this one find a robot
        await stage.kill("arm controller")
        await stage.restart("arm controller")
        await stage.whole()
    return [trial]


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
    released = await _stopped_and_released(one)
    trial = await _replayed(CROSSED, one, other, arms[1].address)
    trial.reached = trial.reached and released
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

    async with _beating(tool, 0.5):
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
    await stage.kill("plain arm")
    return [trial]
