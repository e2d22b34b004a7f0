"""What has not said hello yet, and what a process announces, is bounded; the kernel says who it is."""

from __future__ import annotations

import itertools
import logging
import os
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.vr.base.errors import TooManyKeys
from robotree.vr.network import door as door_module
from robotree.vr.network import rendezvous
from robotree.vr.network.door import MOST_BYTES, MOST_OF_ALL, MOST_OF_ONE, RESERVE, WITHIN, Door
from robotree.vr.network.link import (
    LONGEST_HELLO,
    LONGEST_KEY,
    MOST_KEYS,
    VERSION,
    AskFrame,
    Channel,
    Credentials,
    Hello,
    News,
    PeerLink,
    Topic,
    pack,
)
from robotree.vr.network.mesh import HANGS, MOST_MEMBERS, RECENT, Mesh
from robotree.vr.network.readers import Sockets
from robotree.vr.network.refusals import EVERY, RefusalKind, Refusals
from robotree.vr.network.rendezvous import Rendezvous
from tests.vr.network.visitor import SOON, Visitor, descriptors
from tests.waiting import wait_until

ARM = "robot/arm-1/1"


@pytest.fixture
def mesh(tmp_path: Path) -> Iterator[Mesh]:
    one = Mesh(Rendezvous("test", tmp_path / "r"))
    one.open()
    yield one
    one.close().result(SOON)


@pytest.fixture
def visitor(mesh: Mesh) -> Iterator[Visitor]:
    one = Visitor(mesh.place, mesh.place.tag)
    yield one
    one.close()


def announced(mesh: Mesh) -> set[str]:
    """What others hold, also visitors: they have no beat, and so are not present for long."""
    return {key for peer in list(mesh._peers.values()) for key in list(peer.known[Topic.HOLDS])}


# -- who it is -------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", [VERSION, VERSION + 1])
@pytest.mark.parametrize(
    "name",
    ["1-00000000", "", "x", f"{os.getpid()}", f"{os.getpid()}-0000000g"],
    ids=["other", "none", "word", "number", "no-tag"],  # the same in each worker
)
def test_a_process_that_says_that_it_is_another_one_is_refused_and_the_other_is_not_blamed(
    mesh: Mesh, visitor: Visitor, name: str, version: int
) -> None:
    visitor.dial(Channel.URGENT)
    visitor.say(Channel.URGENT, Hello(version, name, Channel.URGENT, {Topic.HOLDS: [ARM]}))
    assert visitor.is_cut_off(Channel.URGENT)
    assert not mesh.presence.there(ARM)
    assert not mesh._peers
    assert not mesh._outside.strangers


def test_a_process_of_another_version_is_named_with_what_to_do(mesh: Mesh, tmp_path: Path) -> None:
    other = Rendezvous("test", tmp_path / "r")
    with other.register():
        other.hold(ARM)
        visitor = Visitor(mesh.place, mesh.place.tag, tag=other.tag)
        visitor.dial(Channel.URGENT)
        visitor.say(Channel.URGENT, Hello(VERSION + 1, other.tag, Channel.URGENT, {}))
        assert visitor.is_cut_off(Channel.URGENT)
        (held,) = [one for one in mesh.held("robot/*/*") if one.key == ARM]
        assert "runs another version of robotree" in held.remedy
        visitor.close()


def test_a_socket_that_another_process_opened_under_a_name_is_not_connected_to(
    mesh: Mesh, caplog: pytest.LogCaptureFixture
) -> None:
    """The name is of process 1, and this process listens."""
    fake = Rendezvous("test", mesh.place.directory.parent)
    fake.tag = "1-00000000"
    with fake.register() as listening:
        fake.hold(ARM)
        wait_until(lambda: "as if it were process 1;" in caplog.text, "it is not noticed")
        with listening.accept()[0] as line:
            line.settimeout(SOON)
            assert line.recv(100) == b"", "and it is told nothing"
        assert not mesh._peers


def test_hello_is_said_first_and_once(mesh: Mesh, visitor: Visitor) -> None:
    visitor.dial(Channel.URGENT)
    visitor.say(Channel.URGENT, AskFrame(1, ARM, b""))
    assert visitor.is_cut_off(Channel.URGENT)
    visitor.close()
    visitor.greet(ARM)
    wait_until(lambda: mesh.presence.there(ARM), "it is seen")
    visitor.say(Channel.URGENT, Hello(VERSION, visitor.tag, Channel.URGENT, {}))
    assert visitor.is_cut_off(Channel.BULK)
    wait_until(lambda: not mesh.presence.there(ARM), "something of it is left")


def test_a_process_that_dials_again_and_again_has_one_connection_a_channel(
    mesh: Mesh, tmp_path: Path
) -> None:
    """Also where the connection that this side dialed is the one that counts."""
    other = Rendezvous("test", tmp_path / "r")
    other.tag = f"{os.getpid()}-ffffffff"
    with other.register():
        wait_until(lambda: other.tag in mesh._peers, "it is dialed")
        before, visitors = descriptors(), list[Visitor]()
        for _ in range(50):
            visitors.append(Visitor(mesh.place, mesh.place.tag, tag=other.tag))
            visitors[-1].greet(ARM)
        for visitor in visitors[:-1]:
            assert visitor.is_cut_off(Channel.URGENT)
            assert visitor.is_cut_off(Channel.BULK)
            visitor.close()
        wait_until(lambda: descriptors() == before + 4, "others are kept")
        visitors[-1].close()


# -- before it has said hello ----------------------------------------------------------------------


def test_the_largest_greeting_that_is_allowed_is_taken(mesh: Mesh, visitor: Visitor) -> None:
    keys = [f"robot/{number}/".ljust(LONGEST_KEY, "x") for number in range(MOST_KEYS)]
    visitor.greet(*keys)
    wait_until(lambda: len(announced(mesh)) == MOST_KEYS, "it is not taken")
    assert announced(mesh) == set(keys)


@pytest.mark.speed
def test_a_greeting_that_is_too_long_is_refused_before_it_has_come(mesh: Mesh, visitor: Visitor) -> None:
    began = time.monotonic()
    visitor.dial(Channel.URGENT).sendall((LONGEST_HELLO + 1).to_bytes(4, "little") + b"x")
    assert visitor.is_cut_off(Channel.URGENT)
    assert time.monotonic() - began < WITHIN / 2, "its length says so, not the time"
    assert not mesh._peers


def test_greetings_of_one_process_that_never_end_take_no_more_than_one(mesh: Mesh) -> None:
    visitors = [Visitor(mesh.place, mesh.place.tag) for _ in range(6)]
    piece = bytes(LONGEST_HELLO // 4)
    for visitor in visitors:
        visitor.dial(Channel.URGENT).sendall(LONGEST_HELLO.to_bytes(4, "little"))
    for _, visitor in itertools.product(range(3), visitors):
        try:
            visitor.lines[Channel.URGENT].sendall(piece)
        except ConnectionError:
            continue
    ended = [visitor.is_cut_off_now(Channel.URGENT) for visitor in visitors]
    wait_until(lambda: waiting(mesh) <= LONGEST_HELLO, "more is kept")
    assert sum(ended) >= 5
    for visitor in visitors:
        visitor.close()


def waiting(mesh: Mesh) -> int:
    links = [what for what in mesh._sockets.all() if isinstance(what, PeerLink)]
    return sum(link.incomplete for link in links)


def test_a_crowd_of_one_process_that_says_nothing_is_bounded_and_keeps_nobody_out(
    mesh: Mesh, visitor: Visitor, caplog: pytest.LogCaptureFixture
) -> None:
    before = descriptors()
    crowd = [mesh.place.dial(mesh.place.tag) for _ in range(4 * MOST_OF_ONE)]
    visitor.greet(ARM)
    wait_until(lambda: ARM in announced(mesh), "another one is kept out")
    wait_until(lambda: descriptors() <= before + len(crowd) + MOST_OF_ONE + 4, "they are kept")
    assert len(refusals(caplog)) < 5, "they fill the log"
    for line in crowd:
        line.close()


def refusals(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]


class Entrance:
    """A door alone, with a clock and processes of the test."""

    def __init__(self, folder: Path) -> None:
        self.now, self.process = 0.0, itertools.repeat(1)
        self.path = f"{folder}/door"
        listening = socket.socket(socket.AF_UNIX)
        listening.bind(self.path)
        listening.listen(4096)
        listening.setblocking(False)
        self.sockets, self.links = Sockets(), list[PeerLink]()
        self.lines: list[socket.socket] = []
        refusals = Refusals(logging.getLogger("door"), lambda: self.now)
        self.door = Door(
            listening,
            self.sockets,
            wrap=self.wrap,
            close=self.close,
            refusals=refusals,
            clock=lambda: self.now,
        )

    def wrap(self, line: socket.socket) -> PeerLink:
        link = PeerLink(line, wants_to_write=lambda _: None)
        link.far_end = Credentials(next(self.process), os.geteuid())
        self.links.append(link)
        return link

    def close(self, link: PeerLink) -> None:
        self.sockets.remove(link.socket)
        link.close()
        self.door.closed(link)

    def come(self, count: int = 1) -> None:
        for _ in range(count):
            self.lines.append(socket.socket(socket.AF_UNIX))
            self.lines[-1].connect(self.path)
        self.door.accept()
        while any(what == self.door.accept for what, _ in self.sockets.wait(0)):
            self.door.accept()

    def open(self) -> list[PeerLink]:
        return [link for link in self.links if not link.closed]

    def end(self) -> None:
        for link in self.open():
            self.close(link)
        for line in self.lines:
            line.close()
        self.door.close()
        self.sockets.close()


@pytest.fixture
def entrance(tmp_path: Path) -> Iterator[Entrance]:
    one = Entrance(tmp_path)
    yield one
    one.end()


def test_one_that_says_nothing_is_cut_off_in_time_and_one_that_said_hello_stays(entrance: Entrance) -> None:
    entrance.come(2)
    silent, polite = entrance.links
    entrance.door.introduced(polite)
    entrance.now = WITHIN
    entrance.door.tick()
    assert not silent.closed
    entrance.now += 0.1
    entrance.door.tick()
    assert silent.closed
    assert not polite.closed


def test_a_crowd_of_many_processes_is_bounded_at_the_cost_of_the_one_that_has_most(
    entrance: Entrance,
) -> None:
    entrance.process = itertools.count(2)
    entrance.come(MOST_OF_ALL - 20)
    entrance.process = itertools.repeat(1)
    entrance.come(MOST_OF_ONE)
    assert len(entrance.open()) == MOST_OF_ALL
    assert sum(link.far_end.process == 1 for link in entrance.open()) == 20, (
        "only the greedy one has lost some"
    )


def test_greetings_of_many_processes_that_never_end_are_bounded(
    entrance: Entrance, monkeypatch: pytest.MonkeyPatch
) -> None:
    entrance.process = itertools.count(2)
    each = MOST_BYTES // 8
    monkeypatch.setattr(PeerLink, "incomplete", property(lambda link: 0 if link.closed else each))
    entrance.come(20)
    for link in entrance.links:
        entrance.door.came(link)
    assert len(entrance.open()) == 8


def test_a_connection_by_the_reserve_makes_room_for_the_next_one(
    entrance: Entrance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a process that has no other descriptor free: there are as many as the reserve has."""
    taken = len(entrance.open())
    real_next, real_open = entrance.door._listening, os.open

    class Scarce:
        """A listening socket in a process whose descriptors are all taken."""

        def accept(self) -> object:
            if len(entrance.door._reserve) + len(entrance.open()) >= taken + RESERVE:
                raise OSError(24, "too many open files")
            return real_next.accept()

        def __getattr__(self, name: str) -> object:
            return getattr(real_next, name)

    def open_one(*words: object) -> int:
        if len(entrance.door._reserve) + len(entrance.open()) >= taken + RESERVE:
            raise OSError(24, "too many open files")
        return real_open(*words)  # type: ignore[arg-type]

    monkeypatch.setattr(entrance.door, "_listening", Scarce())
    monkeypatch.setattr(os, "open", open_one)
    entrance.come(RESERVE + 3)
    assert len(entrance.open()) == RESERVE
    first = entrance.links[0]
    entrance.close(first)
    assert [what for what, _ in entrance.sockets.wait(0)] == [entrance.door.accept], "it looks again at once"
    entrance.come(0)
    assert len(entrance.links) == RESERVE + 1
    entrance.now += 10 * door_module.STAY
    for link in entrance.links:
        entrance.door.introduced(link)  # they have said hello, and stay
    for number in (2, 3):
        entrance.door.tick()
        entrance.come(0)
        assert len(entrance.links) == RESERVE + number, "nobody makes room"
    monkeypatch.setattr(entrance.door, "_listening", real_next)
    monkeypatch.setattr(os, "open", real_open)


# -- where others crowd ----------------------------------------------------------------------------


@pytest.fixture
def crowded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Rendezvous, socket.socket]]:
    """A process that holds a robot, and in whose line there is no place for one more connection."""
    monkeypatch.setattr(rendezvous, "BACKLOG", 0)
    place = Rendezvous("test", tmp_path / "r")
    with place.register() as listening:
        place.hold(ARM)
        with place.dial(place.tag):
            yield place, listening
    place.leave()


def test_who_dials_waits_a_moment_for_a_place_in_the_line(crowded: tuple[Rendezvous, socket.socket]) -> None:
    place, listening = crowded
    with pytest.raises(BlockingIOError):
        place.dial(place.tag)
    began = time.monotonic()
    with pytest.raises(BlockingIOError):
        place.dial(place.tag, 0.2)
    assert 0.15 < time.monotonic() - began < SOON

    def make_room() -> None:
        listening.accept()[0].close()

    threading.Timer(0.2, make_room).start()
    with place.dial(place.tag, SOON) as line:
        assert not line.getblocking()


def test_one_to_which_no_connection_can_be_made_is_doubted_and_then_said_to_hang(
    crowded: tuple[Rendezvous, socket.socket], tmp_path: Path
) -> None:
    """Nobody says of it that it is not there: its names would be given again."""
    place, _ = crowded
    place.beat(time.monotonic())
    newcomer = Mesh(Rendezvous("test", tmp_path / "r"))
    began = time.monotonic()
    newcomer.open()
    assert time.monotonic() - began > RECENT / 2, "it beats, so it is waited for"
    assert not newcomer.presence.there(ARM)
    assert newcomer.presence.lives(ARM)
    newcomer._outside.undialed[place.tag] = time.monotonic()
    place.beat(time.monotonic())
    assert [(one.key, certain) for one, certain in newcomer.unheard("**")] == [(ARM, False)]
    newcomer._outside.undialed[place.tag] -= HANGS + 0.1
    assert [(one.key, certain) for one, certain in newcomer.unheard("**")] == [(ARM, True)]
    newcomer.close().result(SOON)


# -- what it announces -----------------------------------------------------------------------------


@pytest.mark.parametrize("topic", Topic)
def test_a_greeting_with_too_many_keys_is_refused(mesh: Mesh, visitor: Visitor, topic: Topic) -> None:
    visitor.dial(Channel.URGENT)
    keys = [f"robot/{number}/1" for number in range(MOST_KEYS + 1)]
    visitor.say(Channel.URGENT, Hello(VERSION, visitor.tag, Channel.URGENT, {topic: keys}))
    assert visitor.is_cut_off(Channel.URGENT)
    assert not announced(mesh)


def test_the_keys_of_one_process_are_counted_together(
    mesh: Mesh, visitor: Visitor, caplog: pytest.LogCaptureFixture
) -> None:
    """In all that it announces, in its greeting and later, and under all names that it has in the realm."""
    half = [f"robot/{number}/1" for number in range(MOST_KEYS // 2)]
    visitor.greet(*half, subscribes=half[:-2])
    wait_until(lambda: half[0] in announced(mesh), "it is not taken")
    visitor.say(Channel.URGENT, News(Topic.HOLDS, half[0], there=False))
    visitor.say(
        Channel.URGENT, *(News(Topic.HOLDS, f"robot/more/{number}", there=True) for number in range(3))
    )
    wait_until(lambda: "robot/more/2" in announced(mesh), "as many as are allowed are not taken")
    second = Visitor(mesh.place, mesh.place.tag)
    second.greet(ARM)
    assert second.is_cut_off(Channel.URGENT)
    visitor.say(Channel.URGENT, News(Topic.HOLDS, ARM, there=True))
    assert visitor.is_cut_off(Channel.URGENT)
    wait_until(lambda: not announced(mesh), "something of it is left")
    assert f"announces more than {MOST_KEYS} keys" in caplog.text
    third = Visitor(mesh.place, mesh.place.tag)
    third.greet(ARM)
    wait_until(lambda: ARM in announced(mesh), "what it announces no longer still counts")
    third.close()
    second.close()


def test_a_process_is_in_a_realm_a_bounded_number_of_times(mesh: Mesh) -> None:
    visitors = [Visitor(mesh.place, mesh.place.tag) for _ in range(MOST_MEMBERS + 1)]
    for number, visitor in enumerate(visitors):
        visitor.greet(f"robot/r{number}/1")
        if number < MOST_MEMBERS:
            wait_until(lambda number=number: f"robot/r{number}/1" in announced(mesh), "it is not taken")
    assert visitors[-1].is_cut_off(Channel.URGENT)
    assert len(announced(mesh)) == MOST_MEMBERS
    for visitor in visitors:
        visitor.close()


def test_a_process_announces_no_more_than_others_take(mesh: Mesh) -> None:
    """Else all others would cut it off, and none of its robots could be reached."""
    for number in range(MOST_KEYS - 1):
        mesh.serve(f"robot/{number}/1", lambda *_: None)
    mesh.announce(ARM)
    with pytest.raises(TooManyKeys, match="another host"):
        mesh.announce("robot/more/1")
    assert "robot/more/1" not in (mesh.place.keys_of(mesh.place.tag) or [])
    with pytest.raises(TooManyKeys):
        mesh.serve("robot/more/1", lambda *_: None)
    with pytest.raises(TooManyKeys):
        mesh.subscribe("robot/*/state", lambda *_: None)
    mesh.announce(ARM)  # a second time is no other key
    mesh.end_serving("robot/0/1")
    mesh.subscribe("robot/*/state", lambda *_: None)
    mesh.end_serving("robot/1/1")
    with pytest.raises(TooManyKeys):
        mesh.announce("robot/x/1".ljust(LONGEST_KEY + 1, "x"))


# -- the log ---------------------------------------------------------------------------------------


def test_a_thousand_refusals_of_one_kind_are_a_line_a_second(caplog: pytest.LogCaptureFixture) -> None:
    now = 0.0
    noted = Refusals(logging.getLogger("door"), lambda: now)
    kinds: tuple[RefusalKind, RefusalKind] = ("user", "nonsense")
    for kind in kinds:
        for number in range(1000):
            noted.note(kind, f"{kind} {number}")
    noted.write()
    assert refusals(caplog) == ["user 0", "nonsense 0"]
    now += EVERY
    noted.note("user", "user again")
    noted.write()
    assert refusals(caplog)[2:] == [
        "user again (and 999 more of this kind)",
        "nonsense 999 (and 998 more of this kind)",
    ]
    noted.write()
    now += EVERY
    noted.write()
    noted.note("user", "user later")
    assert refusals(caplog)[4:] == ["user later"]


def test_a_flood_of_nonsense_does_not_fill_the_log(mesh: Mesh, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(500):
        with mesh.place.dial(mesh.place.tag) as line:
            line.setblocking(True)
            line.sendall(pack(AskFrame(1, ARM, b"")))
            assert line.recv(100) == b""
    assert 1 <= len(refusals(caplog)) <= 5
