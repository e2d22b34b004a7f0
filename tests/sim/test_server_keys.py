"""Keys over TCP: who has one may change it, nobody is told it; no recording of one robot moves another."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from robotree.protocol import encode
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.security import UNSIGNED, Security, SignerPair
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
    Ping,
    SetMode,
    SetupSigning,
    SysStatus,
    Verb,
)
from robotree.protocol.signing import Key, Signer, SigningTime, StreamTable, Verifier
from robotree.protocol.testing import RecordingHandler
from robotree.sim.serving.server import Server, serving
from tests.scenarios.test_keys import Operator
from tests.station import PATIENCE, Station
from tests.waiting import until

ANY = "tcp:127.0.0.1:0"
OLD, NEW = b"o" * 32, b"n" * 32
TEXT = f"# the cell\ntcp:127.0.0.1:*  {{key}}\ncan:* {'7f' * 32}\n"
CHANGED = "The signing key was changed by system 7."


class Punctual:
    """Has a key, or one from which those of controllers are derived, and a clock that is right."""

    def __init__(self, key: bytes, *, derives: bool = False) -> None:
        self.key, self.time, self._derives = Key(key), SigningTime(time.time), derives

    def signer_pair(self, controller: str) -> SignerPair:
        key = self.key.of_controller(controller) if self._derives else self.key
        verifier = Verifier(key, self.time, StreamTable())
        return SignerPair(signer=Signer(key, self.time, 200), verifier=verifier)


def station(system: int, security: Any = UNSIGNED) -> Station:
    """Somebody with a key, or none, at the other end of the socket."""
    return Station(system, security=security, greets=False)


def hand_out(sender: Station, key: bytes, moment: int = 0) -> None:
    """Send a key and use it from now on, as MAVProxy does."""
    sender.say(SetupSigning(1, 1, key, moment))
    sender.endpoint.set_signer_pair(**Punctual(key).signer_pair(""))


def garbled(server: Server) -> int:
    """What all clients have said in vain."""
    return sum(each.garbled for each in server._connections.values())


def content(path: Path) -> str:
    return path.read_text()


def file_with(path: Path, text: str) -> Path:
    path.touch(mode=0o600)
    path.write_text(text)
    return path


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return file_with(tmp_path / "cell.keys", TEXT.format(key=OLD.hex()))


def holding(keys: Path, first_link: int = 0) -> Security:
    return Security(Keyring(keys), time.time, first_link=first_link)


async def test_without_a_key_file_a_key_is_refused_in_a_sentence_that_is_said_once() -> None:
    async with serving("rover", ANY) as server:
        client, other = await station(7).dial(server.address), await station(8).dial(server.address)
        for _ in range(5):
            client.say(SetupSigning(1, 1, NEW, 1))
        await client.ping()
        await other.ping()
        assert [text for text in client.sentences if "key" in text] == [
            "This controller has no key file; start with --key FILE."
        ]
        assert not any("key" in text for text in other.sentences)
        assert not [message for message in other.heard if isinstance(message, SetupSigning)]
        assert garbled(server) == 5


async def test_who_has_the_key_changes_it_for_everybody_and_all_are_told(
    keys: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    former = file_with(tmp_path / "former.keys", content(keys))
    async with serving("rover", ANY, security=holding(keys, 100)) as server:
        changer = await station(7, holding(keys)).dial(server.address)
        other = await station(8, holding(former, 50)).dial(server.address)
        await changer.ping()
        await other.ping()
        hand_out(changer, NEW)
        await other.until(lambda: CHANGED in other.sentences)  # it has the old key only, and hears it
        before = other.refused
        await changer.ping()
        await changer.until(lambda: CHANGED in changer.sentences)  # with the new key: so it is obeyed
        asked = next(other._numbers)
        other.say(Ping(0, asked))
        await changer.ping()
        assert not [each for each in other.heard if isinstance(each, Ping) and each.seq == asked], (
            "the old key is obeyed no more"
        )
        await until(lambda: other.refused > before)  # nor is anything said with it
        late = await station(9, holding(former, 60)).dial(server.address)
        late.say(Ping(0, 1))
        again = await station(10, holding(keys, 70)).dial(server.address)
        await again.ping()
        assert late.heard == []
        assert server.rotations == 1
    assert content(keys) == f"{server.address} {NEW.hex()}\n" + TEXT.format(key=OLD.hex())
    assert "the signing key was changed by system 7" in caplog.text
    for shown in (NEW.hex(), repr(NEW)[2:-1], OLD.hex(), repr(OLD)[2:-1]):
        assert shown not in caplog.text
    for client in (changer, other, again):
        assert not [message for message in client.heard if isinstance(message, SetupSigning)]


async def test_who_has_not_the_key_changes_nothing(keys: Path, tmp_path: Path) -> None:
    """Neither unsigned, nor signed with the new key itself, which proves nothing."""
    before = content(keys)
    news = file_with(tmp_path / "new.keys", f"* {NEW.hex()}\n")
    async with serving("rover", ANY, security=holding(keys, 100)) as server:
        strangers = [
            await station(7).dial(server.address),
            await station(8, holding(news)).dial(server.address),
        ]
        for stranger in strangers:
            stranger.say(SetupSigning(1, 1, NEW, 0))
        friend = await station(9, holding(keys)).dial(server.address)
        for _ in strangers:
            await friend.ping()
        refused = [each.endpoint.statistics.refused for each in server._connections.values()]
        assert sorted(refused) == [0, 1, 1]
        await friend.until(
            lambda: any(isinstance(each, SysStatus) and each.errors_comm >= 2 for each in friend.heard)
        )  # it tells how much it has refused
        assert server.rotations == 0
    assert content(keys) == before


@pytest.mark.parametrize("seconds", [0, 10, 1_000_000_000])
async def test_the_time_of_who_changes_the_key_is_taken_over_but_locks_nobody_out(
    keys: Path, seconds: int
) -> None:
    security = holding(keys, 100)
    async with serving("rover", ANY, security=security) as server:
        changer = await station(7, holding(keys)).dial(server.address)
        before = security.now
        hand_out(changer, NEW, before + seconds * 100_000)
        await until(lambda: server.rotations > 0)
        assert min(seconds, 30) * 100_000 <= security.now - before < (min(seconds, 30) + PATIENCE) * 100_000
        punctual = await station(8, Punctual(NEW)).dial(server.address)
        await punctual.ping()


STOP = CommandLong(1, 1, MavCmd.COMPONENT_ARM_DISARM, 0, 0.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("scheme", ["tcp", "udp", "can", "serial"])
async def test_on_no_kind_of_link_is_anybody_obeyed_without_the_key(
    tmp_path: Path, make_cable: Callable[[], Any], scheme: str
) -> None:
    """Neither without one nor with another one. With it the robot stops, so it is the key alone."""
    keys = file_with(tmp_path / "all.keys", f"* {OLD.hex()}\n")
    cable = make_cable() if scheme == "serial" else None
    here = "can:robotree/keys-of-all?node=1" if scheme == "can" else f"{scheme}:127.0.0.1:0"
    here = cable.url(1, "?controller=arm-1") if cable else here
    async with serving("rover", here, security=holding(keys)) as server:
        there = cable.url(0, "?controller=arm-1") if cable else server.address
        for number, security in enumerate((UNSIGNED, Punctual(NEW))):
            stranger = await station(20 + number, security).dial(there)
            for _ in range(3):
                stranger.say(STOP)
            await until(lambda: server._controller.stops == 0 and garbled(server) >= 3)
            stranger.link.close()
            await until(lambda: garbled(server) == 0 or scheme in {"udp", "can", "serial"})
        owner = await station(30, Punctual(OLD, derives=True)).dial(there)
        owner.say(STOP)
        await until(lambda: server._controller.stops > 0)
        assert server._controller.stops == 1, "only the owner's"
        owner.link.close()


async def test_a_key_that_is_sent_twice_is_changed_once(keys: Path) -> None:
    """Some send it twice, since it is not answered; both may come in one piece."""
    async with serving("rover", ANY, security=holding(keys, 100)) as server:
        client = await station(7, holding(keys)).dial(server.address)
        await client.ping()
        signer = client.security.signer_pair(client.link.controller)["signer"]
        client.link.send(
            b"".join(
                encode(SetupSigning(1, 1, NEW, 0), sequence=i, system=7, component=190, signer=signer)
                for i in range(2)
            )
        )
        await until(lambda: server.rotations > 0)
        client.endpoint.set_signer_pair(**Punctual(NEW).signer_pair(""))
        await client.ping()
        assert server.rotations == 1
        assert garbled(server) == 0


@pytest.mark.parametrize(
    ("late", "key", "words"),
    [
        (120.0, OLD, "Your frames are refused: their clock is 120 s behind, and 60 s are allowed"),
        (0.0, NEW, "Your frames are refused: they have the signature of another key"),
    ],
)
async def test_a_client_whose_frames_are_refused_is_told_once_why(
    keys: Path, late: float, key: bytes, words: str
) -> None:
    class Seal(Punctual):
        def __init__(self) -> None:
            super().__init__(key, derives=True)
            self.time = SigningTime(lambda: time.time() - late)

        def signer_pair(self, controller: str) -> SignerPair:
            return SignerPair(signer=super().signer_pair(controller)["signer"], verifier=None)

    async with serving("arm", ANY, security=holding(keys)) as server:
        client = await station(9, Seal()).dial(server.address)
        client.say(Ping(0, 1))
        await client.until(lambda: any(words in each for each in client.sentences))
        for _ in range(5):
            client.say(Ping(0, 1))
        await until(lambda: garbled(server) >= 6)
        assert sum("refused" in each for each in client.sentences) == 1


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
