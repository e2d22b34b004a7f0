"""A client with the key commands the arm; one without it gets an error; it is never shown."""

from __future__ import annotations

import asyncio
import json
import os
import re
import secrets
import signal
import subprocess
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio

from robotree.client.joining import joined
from robotree.protocol import Endpoint
from robotree.protocol.frame import Signer as FrameSigner
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import Security
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    AnyMessage,
    CommandAck,
    CommandLong,
    MavCmd,
    Mode,
    ModeKind,
    Ping,
    SetupSigning,
)
from robotree.protocol.testing import RecordingHandler
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from robotree.vr.base.errors import VrError
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.command_line import ROBOTREE, robotree

pytestmark = pytest.mark.e2e

on_the_cells_loop = pytest.mark.asyncio(loop_scope="module")
REALM = "keys"


class Guarded:
    """A cell whose arm accepts no message without its key, and four clients that try."""

    def __init__(self, folder: Path, crew: Crew, realm_client: RealmClient, address: str) -> None:
        self.folder, self.crew, self.realm_client, self.address = folder, crew, realm_client, address
        self.secrets = [secret_in(folder / file) for file in ("ours.key", "others.key")]
        """All that nobody may be told."""

    async def refusal(self, robot: str, *, of: str) -> str:
        """What a robot says of why it cannot be commanded, once it is what it must become."""
        said = ""
        try:
            async with asyncio.timeout(60):
                while of not in said:
                    await asyncio.sleep(0.02)
                    with pytest.raises(VrError) as refused:
                        await self.realm_client.call(robot, "get_info", {})
                    said = str(refused.value)
        except TimeoutError:
            pytest.fail(f"it never came to that, but said: {said}")
        return said

    def said_by(self, member: str) -> str:
        """All that one of the processes has logged."""
        return "".join(log.read_text() for log in self.folder.glob(f"{member}*.log"))

    async def online(self, robot: str) -> None:
        """Return once the robot is online."""
        async with asyncio.timeout(60):
            while not (await self.realm_client.describe(robot)).online:  # noqa: ASYNC110  an answer has no event
                await asyncio.sleep(0.02)


def secret_in(file: Path) -> str:
    return file.read_text().split()[-1]


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def cell(shared_place: Path) -> AsyncIterator[Guarded]:
    ours, others = shared_place / "ours.key", shared_place / "others.key"
    for file in (ours, others):
        made = robotree("wire", "key", file)
        assert made.returncode == exit_codes.DONE, made.stderr
    async with Crew(REALM, shared_place) as crew:
        arm = await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--key", str(ours))
        where = ("--connect", arm.address)
        await crew.start_all(
            ("lookup", "lookup-1"),
            ("proxy", "arm", "right", *where, "--key", str(ours)),
            ("proxy", "arm", "wrong", *where, "--key", str(others)),
            ("proxy", "arm", "without", *where),
            ("view", "cell", *where, "--key", str(ours)),
        )
        async with joined(REALM) as realm_client:
            yield Guarded(shared_place, crew, realm_client, arm.address)


@on_the_cells_loop
async def test_with_the_key_the_arm_is_commanded_and_looked_at(cell: Guarded) -> None:
    await until(lambda: len(cell.realm_client.robots()) == 3, "all are listed")
    await cell.online("right")
    await cell.realm_client.call("right", "grip", {"action": "width", "width": 0.02})
    assert (await cell.realm_client.call("right", "get_info", {}))["width"] == pytest.approx(0.02, abs=0.005)
    picture = await cell.realm_client.look("cell", width=64, height=36)
    assert (picture.width, picture.height) == (64, 36)


@on_the_cells_loop
async def test_with_another_key_it_is_told_that_frames_arrive_and_none_is_believed(cell: Guarded) -> None:
    said = await cell.refusal("wrong", of="our key")
    assert re.search(r"frames arrive but none is signed with our key \(\d+ refused\)", said)
    assert not (await cell.realm_client.describe("wrong")).online
    logs = "".join(log.read_text() for log in cell.folder.glob("proxy-arm-wrong*.log"))
    assert "frames arrive but none is signed with our key" in logs


@on_the_cells_loop
async def test_without_a_key_the_arm_is_offline_though_it_can_be_heard(cell: Guarded) -> None:
    """It obeys nobody without the key: it must not look as if it could be stopped from here."""
    said = await cell.refusal("without", of="has no key")
    assert re.search(r"its controller signs what it says and this link has no key \(\d+ refused\)", said)
    assert not (await cell.realm_client.describe("without")).online


def test_a_recording_is_signed_anew_by_who_has_the_key(cell: Guarded) -> None:
    """Recorded frames have old signatures; a client with the key may send their content again."""
    key = cell.folder / "ours.key"
    tape, signed = cell.folder / "words.tlog", cell.folder / "signed.tlog"
    recorded = robotree("wire", "record", "--connect", cell.address, tape, "--for", "1s")
    assert recorded.returncode == exit_codes.DONE, recorded.stderr
    words = [*ROBOTREE, "wire", "replay", str(tape), "--listen", "tcp:127.0.0.1:0", "--key", str(key)]
    with subprocess.Popen([*words, "--speed", "max"], stdout=subprocess.PIPE, text=True) as replay:
        assert replay.stdout
        address = replay.stdout.readline().split()[1]
        robotree("wire", "record", "--connect", address, signed)
    before, after = (
        [json.loads(line) for line in robotree("wire", "decode", file, "--json").stdout.splitlines()[:-1]]
        for file in (tape, signed)
    )
    assert len(before) == len(after) > 50
    assert all(frame["signed"] for frame in (*before, *after))
    said = [[(one["name"], one["seq"], one["fields"]) for one in frames] for frames in (before, after)]
    assert said[0] == said[1]
    assert tape.read_bytes() != signed.read_bytes()


@on_the_cells_loop
async def test_a_changed_key_is_found_by_all_who_share_the_file_and_work_goes_on(cell: Guarded) -> None:
    """A ground station changes it while the arm is supervised and looked at."""
    await cell.online("right")
    file, former = cell.folder / "ours.key", cell.folder / "former.key"
    former.touch(mode=0o600)
    former.write_text(file.read_text())
    secret = secrets.token_bytes(32)
    cell.secrets.append(secret.hex())
    await change_key(cell.address, file, secret)
    for member in ("proxy-arm-right", "view-cell"):
        await until(lambda member=member: "its signing key was changed" in cell.said_by(member), member)
    await cell.online("right")
    await cell.realm_client.call("right", "grip", {"action": "width", "width": 0.03})
    assert (await cell.realm_client.call("right", "get_info", {}))["width"] == pytest.approx(0.03, abs=0.005)
    picture = await cell.realm_client.look("cell", width=64, height=36)
    assert (picture.width, picture.height) == (64, 36)
    await cell.refusal("wrong", of="our key")
    assert "the signing key was changed by system 77" in cell.said_by("sim-arm")
    assert "none is signed with our key" not in cell.said_by("proxy-arm-right")
    ping = ("wire", "ping", "--connect", cell.address, "--by", "timesync", "--count", "1")
    codes = [(await asyncio.to_thread(robotree, *ping, "--key", each)).returncode for each in (file, former)]
    assert codes == [exit_codes.DONE, exit_codes.NOBODY]


async def change_key(address: str, file: Path, secret: bytes) -> None:
    """Have the controller take another key, as MAVProxy's `signing setup` does."""
    security = Security(Keyring(file), time.time, first_link=200)

    def accept(link: Link) -> Endpoint:
        signer_pair = security.signer_pair(link.controller)
        endpoint = Endpoint(link, system=77, component=190, on_frame=lambda _: None, **signer_pair)
        endpoint.send(SetupSigning(1, 1, secret, security.now))
        return endpoint

    link = await connect(address, accept)
    await until(lambda: secret.hex() in file.read_text(), "the controller has it in its file")
    link.close()


def test_nobody_is_told_the_key(cell: Guarded) -> None:
    """Not in the list of processes, not in their output, not in their environment."""
    secrets = cell.secrets
    shown = [log.read_text() for log in cell.folder.glob("*.log")]
    for member in cell.crew.members:
        shown += [Path(f"/proc/{member.pid}/{what}").read_text() for what in ("cmdline", "environ")]
    broken = cell.folder / "broken.key"
    broken.touch(mode=0o600)
    broken.write_text(f"* {secret_in(cell.folder / 'ours.key')}0\n")
    for file in ("ours.key", "broken.key"):
        for words in (
            ("wire", "ping", "--connect", "tcp:127.0.0.1:1"),
            ("sim", "arm", "--listen", "tcp:bad"),
        ):
            said = robotree(*words, "--key", cell.folder / file)
            assert said.returncode in {exit_codes.REFUSED, exit_codes.USAGE, exit_codes.NOBODY}
            assert "Traceback" not in said.stderr
            assert said.stderr.count("\n") == 1
            shown += [said.stdout, said.stderr]
    assert len(shown) > 20
    for secret in secrets:
        assert len(secret) == 64
        assert not any(secret[:16] in text for text in shown)


def test_a_passphrase_is_read_from_standard_input_and_never_overwrites(cell: Guarded) -> None:
    words = [*ROBOTREE, "wire", "key", str(cell.folder / "phrase.key"), "--passphrase", "--links", "tcp:*"]
    made, again = (
        subprocess.run(words, input="correct horse\n", capture_output=True, text=True, check=False)
        for _ in range(2)
    )
    assert made.returncode == exit_codes.DONE
    assert "a key for links tcp:*, fingerprint" in made.stdout
    assert "correct" not in made.stdout
    assert again.returncode == exit_codes.REFUSED
    assert "a key is never overwritten" in again.stderr
    empty = subprocess.run(words, input="\n", capture_output=True, text=True, check=False)
    assert empty.returncode == exit_codes.USAGE


# -- a recording of a signed link moves nothing when the controller was killed and is back --------


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
