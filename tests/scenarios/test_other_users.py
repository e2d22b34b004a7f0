"""What another user of this machine can do to a robot: each line of docs/security.md is tried here.

The attacker is a process of its own that has nothing but Python and an address. Where the tests run as root
it runs as another user; else as ours, which can do no less.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.protocol import encode
from robotree.protocol.messages import CommandLong, Heartbeat, MavCmd, Message
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from robotree.tui.wire.security import realm_key
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests.command_line import ROBOTREE, ran

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("place")]
NOBODY = 65534
AS_ANOTHER = {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.geteuid() == 0 else {}
another_user = pytest.mark.skipif(not AS_ANOTHER, reason="only root can play a second user")

SAY = """
import socket, sys, time
host, port, said = sys.argv[1], int(sys.argv[2]), bytes.fromhex(sys.stdin.read())
with socket.create_connection((host, port), 5) as line:
    line.settimeout(0.1)
    heard, end = 0, time.monotonic() + 1.0
    while time.monotonic() < end:
        line.sendall(said)
        try:
            heard += len(line.recv(65536))
        except TimeoutError:
            pass
        time.sleep(0.05)
print(heard)
"""
"""Says the same to a controller again and again, for a second."""

INTRUDE = """
import json, os, socket, sys
folder, told = sys.argv[1], {}
def attempt(name, deed):
    try:
        deed()
        told[name] = "done"
    except OSError as error:
        told[name] = error.strerror
attempt("list", lambda: os.listdir(folder))
attempt("read the key", lambda: open(folder + "/realm.key").read())
attempt("make an entry", lambda: open(folder + "/1-00000000.sock", "w"))
for name in sys.argv[2:]:
    attempt("speak to a process", lambda: socket.socket(socket.AF_UNIX).connect(folder + "/" + name))
print(json.dumps(told))
"""


def attack(script: str, *words: str, said: bytes = b"") -> str:
    """Run a program of another user; it cannot reach our files, so it brings its own text."""
    python = shutil.which("python3", path="/usr/bin:/bin:/usr/local/bin") or sys.executable
    done = ran([python, "-I", "-S", "-c", script, *words], input=said.hex(), cwd="/", within=60, **AS_ANOTHER)
    assert done.returncode == 0, done.stderr
    return done.stdout


def spoken(*messages: Message) -> bytes:
    """The frames of a ground station without a key; it has the ids of our own proxies."""
    return b"".join(
        encode(message, sequence=number, system=255, component=190) for number, message in enumerate(messages)
    )


HERE = Heartbeat(6, 8, 0, 0, 4)
STOP = CommandLong(1, 1, MavCmd.COMPONENT_ARM_DISARM, 0, 0.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.0)
TAKE = CommandLong(1, 1, MavCmd.REQUEST_OPERATOR_CONTROL, 0, 1.0, 1.0, 10.0, 0.0, 0.0, 0.0, 0.0)
DRIVE = CommandLong(1, 1, MavCmd.ROBOTREE_MOVE, 0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.4)


async def say(address: str, *messages: Message) -> int:
    """Have another user say something to a controller; return how many bytes it answered."""
    _, host, port = address.split(":")
    return int(await asyncio.to_thread(attack, SAY, host, port, said=spoken(*messages)))


async def run(*words: str, realm: str = "") -> subprocess.CompletedProcess[bytes]:
    """One command line, as a person types it."""
    given = [*ROBOTREE, *words, *(["--realm", realm] if realm else [])]
    return await asyncio.to_thread(subprocess.run, given, capture_output=True, check=False, timeout=60)


async def until_online(realm_client: RealmClient, name: str) -> None:
    await until(lambda: any(robot.name == name for robot in realm_client.robots()), f"{name} is listed")
    async with asyncio.timeout(60):
        while not (await realm_client.describe(name)).online:  # noqa: ASYNC110  an answer has no event
            await asyncio.sleep(0.02)


@contextlib.asynccontextmanager
async def played(folder: Path, *options: str) -> AsyncGenerator[RealmClient]:
    """The demo as `robotree demo` starts it, in the realm `demo`, with its arm online."""
    demo = await asyncio.create_subprocess_exec(
        *(*ROBOTREE, "demo", "--headless", "--realm", "demo", *options),
        cwd=folder,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    try:
        assert demo.stdout
        await demo.stdout.readline()  # the first step of its script: everybody is up
        async with joined("demo") as realm_client:
            await until_online(realm_client, "rover-1")
            yield realm_client
    finally:
        with contextlib.suppress(ProcessLookupError):
            demo.send_signal(signal.SIGTERM)
        await demo.communicate()


async def test_the_demo_obeys_no_other_user(place: Path, tmp_path: Path) -> None:
    async with played(tmp_path) as realm_client:
        for name in ("arm-1", "rover-1"):
            robot = await realm_client.describe(name)
            assert robot.link == "signed"
            heard = await say(robot.attributes["controller"], HERE, TAKE, DRIVE, STOP)
            assert heard > 0, "what a robot tells is no secret: it can be read, and not forged"
        rover = await realm_client.describe("rover-1")
        assert not rover.stopped
        assert abs(rover.readings["x"]) < 0.01
        assert not (await realm_client.describe("arm-1")).stopped
        await realm_client.call("rover-1", "move", {"x": 0.05, "y": 0.0})
    key = place / "robotree" / "demo" / "realm.key"
    assert key.stat().st_mode & 0o777 == 0o600


@pytest.mark.soak
async def test_the_demo_over_can_obeys_nobody_without_the_realms_key(tmp_path: Path) -> None:
    ping = ["wire", "ping", "--count", "2"]
    async with played(tmp_path, "--can") as realm_client:
        robot = await realm_client.describe("rover-1")
        assert robot.link == "signed"
        ping += ["--connect", robot.attributes["controller"]]
        codes = [(await run(*ping, *key, realm="demo")).returncode for key in ((), ("--key", "realm"))]
    assert codes == [exit_codes.NOBODY, exit_codes.DONE]


@pytest.mark.soak
async def test_the_demo_is_open_to_others_only_on_request(tmp_path: Path) -> None:
    """And so the test above could fail."""
    async with played(tmp_path, "--open") as realm_client:
        rover = await realm_client.describe("rover-1")
        assert rover.link == "open"
        await say(rover.attributes["controller"], HERE, STOP)
        async with asyncio.timeout(60):
            while not (await realm_client.describe("rover-1")).stopped:  # noqa: ASYNC110  an answer has no event
                await asyncio.sleep(0.02)


async def test_an_open_controller_says_so_obeys_anybody_and_is_marked_everywhere(tmp_path: Path) -> None:
    async with Crew("open", tmp_path) as crew:
        rover = await crew.start("sim", "rover", "--listen", "tcp:127.0.0.1:0")
        assert "every user and program of this machine may command it; --key FILE" in rover.log
        await crew.start("lookup", "lookup-1")
        await crew.start("proxy", "rover", "rover-1", "--connect", rover.address)
        async with joined("open") as realm_client:
            await until_online(realm_client, "rover-1")
            await say(rover.address, HERE, TAKE, DRIVE)
            assert (await realm_client.describe("rover-1")).readings["x"] > 0.05
            await say(rover.address, HERE, STOP)
            async with asyncio.timeout(60):
                while not (await realm_client.describe("rover-1")).stopped:  # noqa: ASYNC110  an answer has no event
                    await asyncio.sleep(0.02)
        told = [
            (await run(*words, realm="open")).stdout
            for words in (("ls", "--json"), ("show", "rover-1"), ("tree",))
        ]
    listed, shown, tree = told
    assert [one["link"] for one in json.loads(listed)] == ["open"]
    assert b"open: every program that reaches its controller can command it" in shown
    assert b"open link" in tree


@pytest.fixture
def open_above(place: Path) -> Path:
    """A runtime folder that lies where everybody can go; else the folders above would keep others out."""
    for folder in (place.parent, place):
        folder.chmod(0o755)
    return place


@another_user
def test_the_demo_runs_no_page_that_another_user_has_put_in_its_way(tmp_path: Path) -> None:
    """Its script says `create move_to.py`, and it is played in the folder of its pictures."""
    (tmp_path / "robotree-demo").mkdir()
    (tmp_path / "robotree-demo" / "move_to.py").write_text("open('ran', 'w')")
    os.chown(tmp_path / "robotree-demo", NOBODY, NOBODY)
    said = ran([*ROBOTREE, "demo", "--headless"], cwd=tmp_path, within=60)
    assert said.returncode == exit_codes.REFUSED
    assert said.stderr == f"robotree: robotree-demo: it belongs to somebody else (user {NOBODY})\n"


KNOCK = """
import json, socket, sys
heard = []
for path in sys.argv[1:]:
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(5)
        line.connect(path)
        try:
            line.sendall(b"hello")
            heard.append(line.recv(1))
        except (BrokenPipeError, ConnectionResetError):
            heard.append(b"")
print(len(heard), heard.count(b""))
"""


@another_user
async def test_a_process_talks_to_nobody_else_even_where_the_folder_is_open(
    open_above: Path, tmp_path: Path
) -> None:
    """The kernel says whose process is at the other end: the folder's permissions are not the only wall."""
    async with Crew("mine", tmp_path) as crew:
        lookup = await crew.start("lookup", "lookup-1")
        folder = open_above / "robotree" / "mine"
        sockets = [path for path in folder.iterdir() if path.is_socket()]
        for path in (folder.parent, folder, *sockets):
            path.chmod(0o777)
        told = await asyncio.to_thread(attack, KNOCK, *map(str, sockets))
        assert told.split() == [str(len(sockets))] * 2
        assert f"a process of user {NOBODY} tried to enter the realm; it was refused" in lookup.log
        async with joined("mine") as realm_client:
            await until(lambda: list(realm_client.services) == ["lookup-1"], "who belongs here is heard")


@another_user
async def test_another_user_can_neither_enter_a_realm_nor_read_its_key(open_above: Path) -> None:
    async with Crew("mine") as crew:
        await crew.start("lookup", "lookup-1")
        realm_key("mine")
        folder = open_above / "robotree" / "mine"
        sockets = [path.name for path in folder.iterdir() if path.is_socket()]
        assert sockets
        told = json.loads(await asyncio.to_thread(attack, INTRUDE, str(folder), *sockets))
    assert told == dict.fromkeys(
        ("list", "read the key", "make an entry", "speak to a process"), "Permission denied"
    )
