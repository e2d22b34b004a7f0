"""The stop that is sent before anything else is loaded: its frames, its line, and whom it trusts."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.errors import SupervisorError
from robotree.tui.line import manual
from robotree.vr.base.envelope import seal, sitting_at, this_terminal
from robotree.vr.base.errors import VrError
from robotree.vr.base.principal import SCRIPT
from robotree.vr.base.requests import SafeStop
from robotree.vr.core.confirmation import unmeasured
from robotree.vr.network import lean_stop, realms
from robotree.vr.network.lean_stop import REASON, WITHIN, frames, send_first, understood
from robotree.vr.network.link import VERSION, AskFrame, Channel, Hello, Unpacker, pack
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.supervision.stop import CONFIRM

root_only = pytest.mark.skipif(os.geteuid() != 0, reason="only root can play a second user")
KEYS = [f"robot/r{number}/{'i' * (number % 70)}" for number in range(400)]


@given(st.lists(st.text("ab/ä-", min_size=1, max_size=300), max_size=3), st.floats(0, 1e7))
def test_the_frames_are_those_of_the_network(keys: list[str], now: float) -> None:
    for some in (keys, KEYS):
        sent = frames(some, "0123456789abcdef", now)
        hello = next(iter(Unpacker().feed(sent)))
        assert isinstance(hello, Hello)
        assert hello.member.startswith(f"{os.getpid()}-")
        assert realms.TAG.fullmatch(hello.member)
        stop = SafeStop(reason=REASON, within=WITHIN, order="0123456789abcdef")
        with sitting_at(this_terminal()):
            body = seal(stop, now=now, within=CONFIRM).body
        asked = [pack(AskFrame(number, key, body)) for number, key in enumerate(some, 1)]
        assert sent == b"".join([pack(Hello(VERSION, hello.member, Channel.URGENT, {})), *asked])


def test_its_constants_are_those_of_the_full_order() -> None:
    assert unmeasured(CONFIRM) == pytest.approx(WITHIN)
    assert lean_stop.VERSION == VERSION
    assert lean_stop.SCRIPT == SCRIPT
    assert lean_stop.URGENT == Channel.URGENT


LINE = "stop arm-1 --json --everywhere --realm lab --realm=lab --readonly --calm --help -- -x a.b resume"
WORDS = st.sampled_from([*LINE.split(), "--realm=", "--tether", ""])


@given(st.lists(WORDS, max_size=6))
def test_a_line_that_it_understands_means_the_same_to_the_full_parser(words: list[str]) -> None:
    lean = understood(words)
    if lean is None:
        return
    try:
        line = manual.shell().parse(words)
    except (SupervisorError, VrError):
        return  # a stop too many harms nobody; it is refused afterwards
    assert line.verb == "stop"
    assert lean.name == line.text("NAME")
    assert lean.realm == line.text("--realm")
    assert lean.everywhere == line.flag("--everywhere")


@pytest.mark.parametrize(
    "line",
    [
        "stop",
        "stop arm-1",
        "--json stop --readonly --calm",
        "stop --realm lab",
        "--realm=lab stop",
        "stop --everywhere",
    ],
)
def test_the_usual_lines_are_understood(line: str) -> None:
    assert understood(line.split()) is not None


def test_it_loads_no_library_and_nothing_else_of_robotree() -> None:
    code = (
        "import sys; before = set(sys.modules); import robotree.tui.__main__, robotree.vr.network.lean_stop; "
        "print([name for name in set(sys.modules) - before if name.partition('.')[0] in "
        "{'msgspec', 'asyncio', 'threading', 'logging', 'typing', 'tempfile', 'subprocess', 'inspect'} "
        "or name.startswith(('robotree.tui.', 'robotree.vr.base.', 'robotree.vr.author')) "
        "and name not in {'robotree.tui.__main__', 'robotree.vr.base.os_files'}])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "[]"


class Ear:
    """An entry of a realm that keeps what it is told."""

    def __init__(self, folder: Path, *keys: str, tag: str = "") -> None:
        self.place = Rendezvous(folder.name, folder.parent)
        self.place.tag = tag or self.place.tag
        self.door = self.place.register()
        self.door.settimeout(0.5)
        for key in keys:
            self.place.hold(key)

    def asked(self) -> list[str]:
        """Return the keys of the robots that were asked."""
        heard = b""
        try:
            line, _ = self.door.accept()
        except TimeoutError:
            return []
        with line:
            while data := line.recv(1 << 16):
                heard += data
        return [frame.key for frame in Unpacker().feed(heard) if isinstance(frame, AskFrame)]

    def close(self) -> None:
        """Leave."""
        self.place.leave()
        self.door.close()


@pytest.fixture
def realm(place: Path) -> Path:
    return place / "robotree" / "default"


def test_each_robot_that_a_process_has_written_down_is_asked_once(realm: Path) -> None:
    ear = Ear(realm, "robot/a/1", "host/h/1", "robot/b/1", "robot/gone/1")
    ear.place.drop("robot/gone/1")
    order = send_first(["stop"])
    assert len(order) == 16
    assert ear.asked() == ["robot/a/1", "robot/b/1"]
    assert send_first(["stop", "b"])
    assert ear.asked() == ["robot/b/1"]
    assert send_first(["ls"]) == ""
    ear.close()


def test_a_process_whose_list_is_damaged_is_asked_for_all_robots_that_are_meant(realm: Path) -> None:
    ear = Ear(realm, "robot/a/1", "robot/b/1")
    (realm / f"{ear.place.tag}.held").write_bytes(b"\xff\0\n")
    send_first(["stop"])
    assert ear.asked() == ["robot/*/*"]
    send_first(["stop", "b"])
    assert ear.asked() == ["robot/b/*"]
    ear.close()


@pytest.mark.speed
def test_garbage_in_the_folder_hinders_no_stop(realm: Path) -> None:
    ear = Ear(realm, "robot/a/1")
    (realm / "7-00000000.sock").touch()
    (realm / "7-00000000.held").write_bytes(b"robot/x/1\n\xff\xfe\0\nrobot/\n" * 1000)
    (realm / "8-00000000.sock").symlink_to("/dev/zero")
    os.mkfifo(realm / "8-00000000.held")
    (realm / "9-00000000.held").mkdir()
    began = time.monotonic()
    send_first(["stop"])
    assert time.monotonic() - began < 1.0
    assert ear.asked() == ["robot/a/1"]
    ear.close()


@pytest.mark.speed
def test_a_process_that_never_reads_holds_up_no_other_one(realm: Path) -> None:
    """As a frozen one whose socket takes no more."""
    deaf = Ear(realm, *(f"robot/r{number}/1" for number in range(3000)), tag=f"{os.getpid()}-00000000")
    ear = Ear(realm, "robot/a/1")
    began = time.monotonic()
    send_first(["stop"])
    assert time.monotonic() - began < 1.0
    assert ear.asked() == ["robot/a/1"]
    for one in (deaf, ear):
        one.close()


@root_only
def test_a_socket_of_another_user_is_told_nothing(realm: Path) -> None:
    mine = Ear(realm, "robot/a/1")
    fake = realm / f"{os.getpid()}-00000000.sock"
    door = socket.socket(socket.AF_UNIX)
    door.bind(str(fake))
    os.seteuid(65534)
    try:
        door.listen()  # the kernel notes who listens
    finally:
        os.seteuid(0)
    (realm / f"{os.getpid()}-00000000.held").write_text("robot/fake/1\n")
    send_first(["stop"])
    line, _ = door.accept()
    with line:
        assert line.recv(100) == b""
    assert mine.asked() == ["robot/a/1"]
    door.close()
    mine.close()
