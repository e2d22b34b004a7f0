"""A recording of a signed link moves nothing when the controller was killed and is back."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from pathlib import Path

import pytest

from robotree.protocol import Endpoint
from robotree.protocol.frame import Signer as FrameSigner
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import Security
from robotree.protocol.links.url import connect
from robotree.protocol.messages import AnyMessage, CommandAck, CommandLong, MavCmd, Mode, ModeKind, Ping
from robotree.protocol.testing import RecordingHandler
from robotree.tui.processes.crew import Crew
from robotree.vr.world.testing import until

pytestmark = pytest.mark.e2e


class Operator:
    """Has the key, and keeps all bytes that it sends, as any program on the way can."""

    def __init__(self, key: Path, first_link: int) -> None:
        self._security = Security(Keyring(key), time.time, first_link=first_link)
        self.heard: list[AnyMessage] = []
        self.said: list[bytes] = []

    async def dial(self, address: str) -> Operator:
        self._link = await connect(address, self._accept)
        return self

    def say(self, message: AnyMessage) -> None:
        self._endpoint.send(message)

    def arm(self, on: float) -> None:
        self.say(CommandLong(1, 1, MavCmd.COMPONENT_ARM_DISARM, 0, on, *(0.0,) * 6))

    def latest(self) -> ModeKind | None:
        modes = [each.mode for each in self.heard if isinstance(each, Mode)]
        return ModeKind(modes[-1]) if modes else None

    def answers(self) -> int:
        return sum(isinstance(each, CommandAck) for each in self.heard)

    def _accept(self, link: Link) -> Endpoint:
        signer_pair = self._security.signer_pair(link.controller)
        inner = signer_pair["signer"]
        assert inner is not None
        said = self.said

        class Tapped(FrameSigner):
            def sign(self, frame: bytes) -> bytes:
                said.append(inner.sign(frame))
                return said[-1]

        self._endpoint = Endpoint(
            link,
            system=255,
            component=190,
            on_frame=lambda frame: self.heard.append(frame.message),
            signer=Tapped(),
            verifier=signer_pair["verifier"],
        )
        return self._endpoint


async def test_disarm_and_arm_of_the_last_seconds_are_not_obeyed_again(place: Path) -> None:
    key = place / "cell.key"
    create(key)
    words = ("sim", "arm", "--key", str(key), "--listen")
    async with Crew("replay", place) as crew:
        first = await crew.start(*words, "tcp:127.0.0.1:0")
        operator = await Operator(key, 1).dial(first.address)
        operator.arm(0.0)
        await until(lambda: operator.latest() == ModeKind.SAFE_STOP, "it is disarmed")
        operator.arm(1.0)
        await until(lambda: operator.latest() == ModeKind.READY, "and armed")
        os.kill(first.pid, signal.SIGKILL)
        await first.process.wait()

        again = await crew.start(*words, first.address)
        witness = await Operator(key, 100).dial(again.address)
        await until(lambda: witness.latest() == ModeKind.READY, "it is back")
        attacker = await connect(again.address, RecordingHandler)
        for frame in operator.said:
            attacker.send(frame)
        told = asyncio.get_running_loop().time()
        witness.arm(0.0)
        await until(lambda: witness.latest() == ModeKind.SAFE_STOP, "who has the key now is obeyed")
        assert asyncio.get_running_loop().time() - told < 5.0
        for frame in operator.said:
            attacker.send(frame)
        witness.say(Ping(0, 1))
        await until(lambda: any(isinstance(each, Ping) for each in witness.heard), "all was heard")
        assert witness.latest() == ModeKind.SAFE_STOP, "the recorded arming released it"
        assert {each.stops for each in witness.heard if isinstance(each, Mode)} <= {1, 2}
        attacker.close()
