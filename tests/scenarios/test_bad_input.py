"""Bad input to the running arm is counted, or refused in one sentence, and the arm keeps its time.

A real `robotree sim arm` is thrown at over real TCP. Meanwhile a witness on a connection of its own asks PING
and compares the simulated clock in the telemetry with the clock on the wall. Forgiven is only what a busy
machine withholds: the time that threads waited for a processor, as the kernel counts it.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import random
import socket
import statistics
import time
from collections.abc import AsyncGenerator, AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Self, TypeVar

import pytest
import pytest_asyncio
from fastcrc.crc16 import mcrf4xx

from robotree.protocol import Endpoint, Frame, Parser, encode
from robotree.protocol.codec import SIGNED
from robotree.protocol.errors import LinkError
from robotree.protocol.frame import CRC_START
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import UNSIGNED, LinkSecurity, Security
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    TYPED,
    AnyMessage,
    CommandLong,
    Goal,
    GoalState,
    GoalStatus,
    Heartbeat,
    Joints,
    MavCmd,
    MavType,
    ParamRequestList,
    PictureRequest,
    Ping,
    Statustext,
    SysStatus,
    Tool,
    Verb,
)
from robotree.protocol.services.peer import Peer
from robotree.protocol.services.ping import Pinger
from robotree.sim.serving.realtime import LARGEST_DEBT
from robotree.tui.processes.crew import Crew, Member
from tests.withheld import Withheld

pytestmark = [pytest.mark.e2e, pytest.mark.asyncio(loop_scope="module")]

BEAT = Heartbeat(6, 8, 0, 0, 4)
NAN = math.nan
PERIOD, SHORTEST_WATCH = 0.02, 2.5
"""[s] between two questions of the witness; [s] that it looks at least."""
LONGEST_PING = 0.25
"""[s] that half of the answers take at most."""
SERVED = 32
"""Clients that an arm serves at a time."""
LARGEST_COUNT = 65535
"""Where a counter on the wire stands still."""
PATIENCE = 60.0
"""[s]; an arm reads no more than 512 kB in a second."""
M = TypeVar("M", bound=AnyMessage)


class Client:
    """A client with a connection to the arm, which sends what the test chooses."""

    def __init__(self, component: int = 190) -> None:
        self.component = component
        self.heard: list[AnyMessage] = []
        self.end: LinkError | None = None
        self._news = asyncio.Event()

    async def dial(self, address: str, security: LinkSecurity = UNSIGNED) -> Self:
        self.link = await connect(address, lambda link: self._accept(link, security))
        self.say(BEAT)
        return self

    def _accept(self, link: Link, security: LinkSecurity) -> Endpoint:
        self.mouth = Endpoint(
            link,
            system=255,
            component=self.component,
            on_frame=self.hear,
            on_closed=self._ended,
            **security.signer_pair(link.controller),
        )
        return self.mouth

    def say(self, message: AnyMessage) -> None:
        self.mouth.send(message)

    def hear(self, frame: Frame) -> None:
        self.heard.append(frame.message)
        self._news.set()

    def _ended(self, reason: LinkError) -> None:
        self.end = reason
        self._news.set()

    def of(self, kind: type[M]) -> list[M]:
        return [message for message in self.heard if isinstance(message, kind)]

    @property
    def told(self) -> list[str]:
        """The texts that the arm has sent."""
        return [status.text for status in self.of(Statustext)]

    async def until(self, holds: Callable[[], object], otherwise: str) -> None:
        try:
            async with asyncio.timeout(PATIENCE):
                while not holds():
                    assert self.end is None, f"{otherwise}: {self.end}; it was told {self.told}"
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            pytest.fail(f"{otherwise} within {PATIENCE:g} s")


class Witness(Client):
    """Somebody who behaves, and sees how the arm bears the others."""

    def __init__(self) -> None:
        super().__init__(component=191)
        self._pinger = Pinger(255, 191)
        self._clock: list[tuple[float, int]] = []
        """Our time [s] and the arm's [ms], whenever it told."""
        self._trips: list[float] = []

    def hear(self, frame: Frame) -> None:
        match frame.message:
            case Tool(time_boot_ms=then):
                self._clock.append((time.monotonic(), then))
            case Ping() as answer:
                speaker = Peer(self.link, frame.system, frame.component)
                if (echo := self._pinger.receive(answer, speaker, time.monotonic())) is not None:
                    self._trips.append(echo.round_trip)
            case _:
                super().hear(frame)

    @property
    def counted(self) -> int:
        """The arm's own count of bad input so far."""
        return max((status.errors_comm for status in self.of(SysStatus)), default=0)

    async def counts(self, number: int) -> None:
        await self.until(lambda: self.counted >= number, f"it did not count {number} bad inputs")

    @contextlib.asynccontextmanager
    async def watching(self, arm: Member) -> AsyncGenerator[None]:
        """Hold that the arm keeps real time and answers everything while the block runs."""
        await self.until(lambda: self.of(SysStatus), "it told nothing about itself")
        self._clock.clear()
        self._trips.clear()
        begun, waiting = time.monotonic(), Withheld(arm.pid, os.getpid())
        asking = asyncio.create_task(self._ask(), name="witness")
        try:
            yield
            await asyncio.sleep(max(0.0, begun + SHORTEST_WATCH - time.monotonic()))
            over = time.monotonic()
            await self.until(lambda: self._clock and self._clock[-1][0] > over, "telemetry came to the end")
        finally:
            asking.cancel()
        withheld = waiting.seconds
        assert self.end is None, f"the witness lost its connection: {self.end}"
        (first, since), (last, until) = self._clock[0], self._clock[-1]
        lost = last - first - (until - since) / 1000
        assert lost < LARGEST_DEBT + withheld, (
            f"lost {lost:.3f} s of {last - first:.3f}, {withheld:.3f} withheld"
        )
        assert not self._pinger.lost, f"{self._pinger.lost} questions were never answered"

    def assert_quick(self) -> None:
        """Hold that most answers of the last watch came soon, which a busy machine may prevent."""
        assert statistics.median(self._trips) < LONGEST_PING, "half of the answers were slow"

    async def _ask(self) -> None:
        beats = 0.0
        while True:
            now = time.monotonic()
            if now > beats + 1.0:
                beats = now
                self.say(BEAT)
            self._pinger.tick(now)
            self.say(self._pinger.ask(now))
            await asyncio.sleep(PERIOD)


class Bench:
    """The arm that most tests share, and others where a test wants one."""

    def __init__(self, folder: Path, crew: Crew, arm: Member) -> None:
        self.folder, self.crew, self.arm, self.address = folder, crew, arm, arm.address

    async def another_arm(self, *words: str) -> Member:
        return await self.crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0", *words)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def bench(shared_place: Path) -> AsyncIterator[Bench]:
    async with Crew("bad-input", shared_place) as crew:
        yield Bench(shared_place, crew, await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0"))


C = TypeVar("C", bound=Client)
Dial = Callable[..., Awaitable[C]]


@pytest_asyncio.fixture(loop_scope="module")
async def dial(bench: Bench) -> AsyncIterator[Dial[Client]]:
    """Lets a client in; all of them leave after the test, whatever became of it."""
    let_in: list[Client] = []

    async def dial(client: C, address: str = bench.address, security: LinkSecurity = UNSIGNED) -> C:
        let_in.append(await client.dial(address, security))
        return client

    yield dial
    for client in let_in:
        client.link.close()


@pytest_asyncio.fixture(loop_scope="module")
async def witness(dial: Dial[Witness]) -> Witness:
    return await dial(Witness())


def _raw(msgid: int, payload: bytes, crc_extra: int, *, flip: int = 0, flags: int = 0) -> bytes:
    """A frame that our encoder would not make: any id, length and flags, a checksum with flipped bits."""
    frame = bytes((0xFD, len(payload), flags, 0, 0, 255, 190)) + msgid.to_bytes(3, "little") + payload
    checksum = mcrf4xx(frame + bytes((crc_extra,)), CRC_START) ^ flip
    return frame + checksum.to_bytes(2, "little")


def _is_one_sentence(text: str) -> bool:
    return len(text.split()) > 3 and "\n" not in text and ". " not in text


async def _throw(address: str, data: bytes) -> None:
    """Say some bytes, and wait until the arm has taken them all."""
    host, port = address.removeprefix("tcp:").rsplit(":", 1)
    reader, writer = await asyncio.open_connection(host, int(port))

    async def listen() -> None:
        while await reader.read(65536):
            pass

    hearing = asyncio.create_task(listen())
    writer.write(data)
    writer.write_eof()
    await asyncio.wait_for(hearing, PATIENCE)
    writer.close()
    await writer.wait_closed()


BAD_FRAMES = {
    "wrong checksum": _raw(Goal.codec.definition.id, b"\1" * 40, Goal.codec.crc_extra[0], flip=0x4000),
    "unknown id": _raw(0xEEEEEE, b"\1" * 40, 7),
    "unknown flags": _raw(Goal.codec.definition.id, b"\1" * 40, Goal.codec.crc_extra[0], flags=0x40),
}


@pytest.mark.parametrize("name", BAD_FRAMES)
async def test_bad_frames_are_counted(name: str, bench: Bench, witness: Witness) -> None:
    number = 3000
    async with witness.watching(bench.arm):
        before = witness.counted
        await _throw(bench.address, BAD_FRAMES[name] * number)
        await witness.counts(before + number)
        assert witness.counted >= before + number


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(1_000_000, marks=pytest.mark.speed),
        pytest.param(10_000_000, marks=pytest.mark.soak),
    ],
    ids=["1 MB", "10 MB"],
)
async def test_bytes_of_chance_are_counted(number: int, bench: Bench, dial: Dial[Witness]) -> None:
    arm = await bench.another_arm()
    witness = await dial(Witness(), arm.address)
    chance = random.Random(0).randbytes(number)
    alone = Parser()
    alone.feed(chance)
    expected = alone.statistics.bad_crc + alone.statistics.unknown
    async with witness.watching(arm):
        await _throw(arm.address, chance)
        await witness.counts(min(expected, LARGEST_COUNT))
    witness.assert_quick()
    assert witness.counted <= expected + 1, "nothing is counted twice"


async def test_frames_of_another_key_and_of_none_are_counted_and_not_answered(
    bench: Bench, dial: Dial[Witness]
) -> None:
    ours, others = bench.folder / "ours.key", bench.folder / "others.key"
    create(ours)
    create(others)
    arm = await bench.another_arm("--key", str(ours))
    witness = await dial(Witness(), arm.address, Security(Keyring(ours), time.time))
    stranger = Security(Keyring(others), time.time).signer_pair(arm.address)["signer"]
    assert stranger is not None
    forged = [
        encode(CommandLong(1, 1, MavCmd.COMPONENT_ARM_DISARM, 0, *(0.0,) * 7), sequence=i, system=255,
               component=190, signer=signer)
        for i in range(1000) for signer in (stranger, None)
    ]  # fmt: skip
    assert forged[0][2] == SIGNED
    async with witness.watching(arm):
        await _throw(arm.address, b"".join(forged))
        await witness.counts(len(forged))
    beats = [beat for beat in witness.of(Heartbeat) if beat.type != MavType.CAMERA]
    assert all(beat.base_mode & 128 for beat in beats), "nobody has stopped the arm"


async def test_arrays_that_are_longer_than_we_know_are_read_as_far_as_we_know(
    bench: Bench, witness: Witness, dial: Dial[Client]
) -> None:
    """A newer dialect may have appended to them; what we know is understood as ever."""
    long = [_raw(kind.codec.definition.id, b"\xff" * 255, kind.codec.crc_extra[0]) for kind in TYPED.values()]
    question = (2**63).to_bytes(8, "little") + (77).to_bytes(4, "little") + bytes(243)
    asker = await dial(Client())
    async with witness.watching(bench.arm):
        asker.link.send(_raw(Ping.codec.definition.id, question, Ping.codec.crc_extra[0]))
        await asker.until(lambda: [one for one in asker.of(Ping) if one.seq == 77], "PING was not answered")
        await _throw(bench.address, b"".join(long) * 20)


async def test_goals_that_mean_nothing_are_refused_in_one_sentence(
    bench: Bench, witness: Witness, dial: Dial[Client]
) -> None:
    client = await dial(Client())
    senseless = [(math.inf, 0.0, 0.3), (0.4, -math.inf, 0.3), (1e30, 0.0, 0.3), (0.4, 0.0, 0.3, NAN, 1e30)]
    async with witness.watching(bench.arm):
        for key, args in enumerate(senseless, random.getrandbits(60)):
            client.heard.clear()
            client.say(Goal(key, 0, 0, (*args, *(NAN,) * (7 - len(args))), Verb.GO_TO, 1, 1))
            await client.until(lambda: client.of(GoalStatus), "nothing was answered")
            (status,) = client.of(GoalStatus)
            assert (status.key, status.state) == (key, GoalState.REFUSED)
            assert _is_one_sentence(status.text), status.text


@pytest.mark.speed
async def test_a_thousand_who_say_nothing_keep_nobody_from_being_served(
    bench: Bench, witness: Witness, dial: Dial[Client]
) -> None:
    host, port = bench.address.removeprefix("tcp:").rsplit(":", 1)
    with contextlib.ExitStack() as half_open:
        async with witness.watching(bench.arm):
            for _ in range(1000):
                one = half_open.enter_context(socket.socket())
                one.setblocking(False)
                with contextlib.suppress(ConnectionError):
                    await asyncio.get_running_loop().sock_connect(one, (host, int(port)))
            newcomer = await dial(Client())
            await newcomer.until(lambda: newcomer.of(Tool), "a newcomer who speaks was not served")
        witness.assert_quick()
        assert newcomer.end is None


@pytest.mark.speed
async def test_who_is_one_too_many_is_told_so_in_one_sentence(
    bench: Bench, witness: Witness, dial: Dial[Client]
) -> None:
    async with witness.watching(bench.arm):
        crowd: list[Client] = []
        for i in range(SERVED - 1):
            crowd.append(await dial(Client(1 + i)))
            crowd[-1].say(Ping(1, i))
            await crowd[-1].until(lambda: crowd[-1].of(Ping), "it was not served")
        crowd.append(await dial(Client()))
        last = crowd[-1]
        await last.until(lambda: last.end is not None, "it was not sent away")
    witness.assert_quick()
    (text,) = last.of(Statustext)
    assert _is_one_sentence(text.text), text.text
    assert "clients are served already" in text.text


@pytest.mark.speed
async def test_who_asks_for_everything_and_never_reads_costs_itself(bench: Bench, witness: Witness) -> None:
    host, port = bench.address.removeprefix("tcp:").rsplit(":", 1)
    greedy = socket.socket()
    greedy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    greedy.setblocking(False)
    loop = asyncio.get_running_loop()
    await loop.sock_connect(greedy, (host, int(port)))
    interval = MavCmd.SET_MESSAGE_INTERVAL
    wishes: list[AnyMessage] = [
        BEAT,
        *(CommandLong(1, 1, interval, 0, msgid, 1000.0, *(0.0,) * 5) for msgid in TYPED),
        ParamRequestList(1, 1),
        *(PictureRequest(640, 360, 1, camera, 90) for camera in (100, 101)),
        *(Ping(1, number) for number in range(100)),
    ]
    every = b"".join(encode(wish, sequence=0, system=255, component=7) for wish in wishes)
    async with witness.watching(bench.arm):
        with contextlib.suppress(ConnectionError, TimeoutError):  # cut, or never
            async with asyncio.timeout(4):  # of flood
                while True:
                    await loop.sock_sendall(greedy, every)
                    await asyncio.sleep(PERIOD)
    greedy.close()
    witness.assert_quick()
    assert len(witness.of(Joints)) > 50, "the witness was served all the while"
