"""The meeting place: which processes it lets in, what it leaves behind, and why it cannot be used."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import random
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from robotree.vr.base.errors import BadName, RealmUnusable
from robotree.vr.network import mesh as mesh_module
from robotree.vr.network import realms
from robotree.vr.network.lean_stop import StopLine
from robotree.vr.network.local import join
from robotree.vr.network.mesh import RECENT, Mesh
from robotree.vr.network.readers import What
from robotree.vr.network.realms import all_realms, realm_folder, runtime_directory
from robotree.vr.network.rendezvous import Rendezvous, realm_name

ARM = "robot/a/1"
root_only = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a directory away")


def place_at(folder: Path) -> Rendezvous:
    return Rendezvous("test", folder / "r")


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[Rendezvous, Rendezvous]]:
    """A process that is there, and one that only looks."""
    one, other = place_at(tmp_path), place_at(tmp_path)
    with one.register():
        yield one, other


def names(place: Rendezvous) -> set[str]:
    return {path.name for path in place.directory.iterdir()}


def test_a_newcomer_sees_all_who_came_before_and_none_who_left(tmp_path: Path) -> None:
    first, second, third = (place_at(tmp_path) for _ in range(3))
    doors = [place.register() for place in (first, second)]
    assert second.others() == [first.tag]
    assert third.others() == sorted([first.tag, second.tag])
    first.leave()
    first.leave()
    assert third.others() == [second.tag]
    second.leave()
    assert names(third) == set()
    for door in doors:
        door.close()


def test_the_dead_refuse_and_are_forgotten(tmp_path: Path) -> None:
    dead, newcomer = place_at(tmp_path), place_at(tmp_path)
    dead.register().close()  # as the kernel does when a process dies
    dead.hold(ARM)
    with pytest.raises(ConnectionRefusedError):
        newcomer.dial(dead.tag)
    newcomer.forget(dead.tag)
    assert names(newcomer) == set()


def test_what_a_process_holds_no_longer_is_taken_back_line_by_line_and_the_list_stays_short(
    pair: tuple[Rendezvous, Rendezvous],
) -> None:
    one, other = pair
    keys = [f"robot/r{number}/1" for number in range(300)]
    for key in [*keys, keys[0]]:
        one.hold(key)
    written = (one.directory / f"{one.tag}.held").stat().st_ino
    for key in [*keys[:100], keys[1]]:
        one.drop(key)
    assert other.keys_of(one.tag) == [keys[0], *keys[100:]]
    assert (one.directory / f"{one.tag}.held").stat().st_ino == written, "not one of them wrote all others"
    for _ in range(500):
        one.hold("robot/again/1")
        one.drop("robot/again/1")
    assert other.keys_of(one.tag) == [keys[0], *keys[100:]]
    assert len((one.directory / f"{one.tag}.held").read_text().splitlines()) < 3 * 300
    for key in (keys[0], *keys[100:]):
        one.drop(key)
    assert other.keys_of(one.tag) == []
    one.leave()
    one.hold(ARM)
    assert other.keys_of(one.tag) is None


@pytest.mark.parametrize("fails", [0, -1])
def test_a_list_that_cannot_be_written_whole_is_removed_and_written_anew(
    pair: tuple[Rendezvous, Rendezvous], monkeypatch: pytest.MonkeyPatch, fails: int
) -> None:
    """As on a full disk: without a list a process is named by each stop, with a wrong one it is missed."""
    one, other = pair
    one.hold(ARM)

    def write(*_: object) -> int:
        if fails < 0:
            raise OSError(errno.ENOSPC, "no space left on device")
        return fails

    with monkeypatch.context() as full:
        full.setattr(os, "write", write)
        one.hold("robot/b/1")
    assert other.keys_of(one.tag) is None
    assert not one.registered()
    one.register().close()
    assert other.keys_of(one.tag) == [ARM, "robot/b/1"]


@pytest.mark.parametrize(
    "damage",
    [
        form(lines)
        for lines in (b"\xff\x00\n-\n", b"robot/a/1\n-robot/b/1\n", b"robot/\x07/1\nrobot/b/1\n")
        for form in (bytes, realms.sealed)
    ],
)
def test_a_damaged_list_is_none_and_its_process_mends_it(
    pair: tuple[Rendezvous, Rendezvous], damage: bytes
) -> None:
    """Who believed it would leave a robot out of a stop and say that all have stopped."""
    one, other = pair
    for key in (ARM, "robot/b/1"):
        one.hold(key)
    assert one.registered()
    (one.directory / f"{one.tag}.held").write_bytes(damage)
    assert other.keys_of(one.tag) is None
    assert not one.registered()
    one.hold("robot/c/1")
    assert other.keys_of(one.tag) == [ARM, "robot/b/1", "robot/c/1"], "what is added mends it, too"
    (one.directory / f"{one.tag}.held").write_bytes(b"")
    assert not one.registered()
    one.drop("robot/c/1")
    assert other.keys_of(one.tag) == [ARM, "robot/b/1"], "and what is taken back"
    (one.directory / f"{one.tag}.held").write_bytes(b"")
    one.register().close()
    assert one.registered()
    assert other.keys_of(one.tag) == [ARM, "robot/b/1"]


def test_every_byte_of_a_list_is_proven(pair: tuple[Rendezvous, Rendezvous]) -> None:
    one, other = pair
    for key in (ARM, "robot/b/1"):
        one.hold(key)
    one.drop(ARM)
    path = one.directory / f"{one.tag}.held"
    written = path.read_bytes()
    for size in range(len(written)):
        path.write_bytes(written[:size])
        assert other.keys_of(one.tag) is None, f"cut to {size} bytes"
    for place in range(len(written)):
        for bit in range(8):
            path.write_bytes(written[:place] + bytes([written[place] ^ 1 << bit]) + written[place + 1 :])
            assert other.keys_of(one.tag) is None, f"bit {bit} of byte {place}"


@pytest.mark.parametrize("step", range(1, 12))
def test_a_line_that_is_being_written_damages_no_list(
    pair: tuple[Rendezvous, Rendezvous], monkeypatch: pytest.MonkeyPatch, step: int
) -> None:
    """Its process may be frozen just then: the list is that of before until the line is sealed."""
    one, other = pair
    one.hold(ARM)
    seen: list[list[str] | None] = []
    write = os.write

    def in_pieces(handle: int, line: bytes) -> int:
        done = write(handle, line[:step])
        seen.append(other.keys_of(one.tag))
        done += write(handle, line[step:])
        seen.append(other.keys_of(one.tag))
        return done

    with monkeypatch.context() as slow:
        slow.setattr(os, "write", in_pieces)
        one.hold("robot/b/1")
        one.drop(ARM)
    assert seen == [[ARM]] * 2 + [[ARM, "robot/b/1"]] * 2
    assert other.keys_of(one.tag) == ["robot/b/1"]


def test_who_reads_while_another_process_writes_never_reads_a_damaged_list(tmp_path: Path) -> None:
    """Lines are added and taken back, and the whole list is written anew, as fast as it goes."""
    place = place_at(tmp_path)
    child = os.fork()
    if not child:
        with contextlib.suppress(BaseException):
            writer = place_at(tmp_path)
            writer.tag = place.tag
            writer.register()
            for number in range(5_000):
                writer.hold(f"robot/r{number}/1")
                writer.drop(f"robot/r{number}/1")
        os._exit(0)
    found, ended = 0, False
    while not ended:
        ended = os.waitpid(child, os.WNOHANG)[0] == child
        keys = place.keys_of(place.tag)
        if keys is not None:
            found += 1
        else:
            assert not found, "it had been there"
    assert found > 10
    assert place.keys_of(place.tag) == []


def test_a_newcomer_that_finds_no_room_leaves_nothing(
    pair: tuple[Rendezvous, Rendezvous], monkeypatch: pytest.MonkeyPatch
) -> None:
    there, newcomer = pair
    before = names(there)

    def write(*_: object) -> int:
        raise OSError(errno.ENOSPC, "no space left on device")

    monkeypatch.setattr(os, "pwrite", write)
    with pytest.raises(RealmUnusable, match="no space left on device"):
        newcomer.register()
    newcomer.leave()
    assert names(there) == before


def test_a_process_that_found_no_room_for_its_sign_of_life_registers_again_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder of its realm was lost while the disk was full."""
    place, other = place_at(tmp_path), place_at(tmp_path)
    place.register().close()
    opened = os.open

    def no_room(path: object, flags: int, *words: object, **more: object) -> int:
        if flags & os.O_CREAT:
            raise OSError(errno.ENOSPC, "no space left on device")
        return opened(path, flags, *words, **more)  # type: ignore[arg-type]

    with monkeypatch.context() as full:
        full.setattr(os, "open", no_room)
        for _ in range(2):
            with pytest.raises(RealmUnusable, match="no space left on device"):
                place.register()
            place.beat(1.0)
    place.register().close()
    place.beat(7.0)
    beat = other.beat_of(place.tag)
    assert beat is not None
    assert beat.read() == 7.0
    beat.close()
    place.leave()


def test_a_sign_of_life_can_be_read_without_asking_for_it(tmp_path: Path) -> None:
    one, other = place_at(tmp_path), place_at(tmp_path)
    assert other.beat_of(one.tag) is None
    door = one.register()
    one.beat(42.5)
    beat = other.beat_of(one.tag)
    assert beat is not None
    assert beat.read() == 42.5
    os.truncate(one.directory / f"{one.tag}.beat", 0)
    assert beat.read() == 0.0
    beat.close()
    one.leave()
    door.close()


def test_files_that_are_none_of_ours_harm_nobody(tmp_path: Path) -> None:
    """Whatever lies in the folder: names that are no text, pipes, folders, links to other files."""
    place, tag = place_at(tmp_path), f"{2**22}-00000000"
    (tmp_path / "precious").write_text("kept")
    for end in (".sock", ".beat", ".held"):
        (place.directory / f"7-0000000{end[1]}{end}").mkdir()
    (place.directory / f"{tag}.sock").symlink_to(tmp_path / "precious")
    (place.directory / f"{tag}.beat").symlink_to(tmp_path / "precious")
    os.mkfifo(place.directory / f"{tag}.held")
    Path(os.fsdecode(os.fsencode(place.directory) + b"/\xff\xfe.sock")).touch()
    assert place.others() == [tag]
    assert place.keys_of(tag) is None
    assert place.beat_of(tag) is None
    with pytest.raises(ConnectionRefusedError):
        place.dial(tag)
    place.forget(tag)
    assert place.others() == []
    assert (tmp_path / "precious").read_text() == "kept"


def test_what_was_abandoned_on_the_way_in_is_removed_after_a_while(tmp_path: Path) -> None:
    place = place_at(tmp_path)
    old, new = place.directory / ".7-00000000", place.directory / ".8-00000000"
    for path in (old, new):
        path.touch()
    os.utime(old, (0, 0))
    assert place.others() == []
    assert names(place) == {new.name}


def test_the_place_is_private(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir(mode=0o755)
    place = Rendezvous("test", tmp_path / "r")
    assert place.directory.stat().st_mode & 0o777 == 0o700
    assert (tmp_path / "r").stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (lambda root: (root / "r").write_text("a file"), "set XDG_RUNTIME_DIR"),
        (lambda root: (root / "r").symlink_to(root / "else"), "symbolic link"),
        (lambda root: ((root / "r").mkdir(), (root / "r/test").symlink_to(root / "else")), "symbolic link"),
        (lambda root: root.chmod(0o777), "where every user can write"),
        pytest.param(
            lambda root: ((root / "r").mkdir(), os.chown(root / "r", 65534, 65534)),
            "belongs to somebody else",
            marks=root_only,
        ),
        pytest.param(lambda root: os.chown(root, 65534, 65534), "belongs to user 65534", marks=root_only),
    ],
)
def test_a_place_that_is_not_this_users_alone_is_refused_and_nothing_is_made_there(
    tmp_path: Path, prepare: Callable[[Path], object], words: str
) -> None:
    root = tmp_path / "root"
    (root / "else").mkdir(parents=True)
    root.chmod(0o1777)  # as /tmp: nobody else can rename what is ours
    (root / "else").chmod(0o1777)
    assert Rendezvous("test", root / "mine").directory.is_dir()
    prepare(root)
    with pytest.raises(RealmUnusable, match=words):
        Rendezvous("test", root / "r")
    assert (root / "else").stat().st_mode & 0o7777 == 0o1777
    assert not list((root / "else").iterdir())


async def test_a_path_too_long_for_a_socket_is_no_obstacle(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 120)
    one, other = await join("test", root=deep), await join("test", root=deep)
    token = await one.announce(ARM)
    async with asyncio.timeout(60):
        while not other.presence.keys("robot/*/*"):  # noqa: ASYNC110 # the question is the thing examined
            await asyncio.sleep(0.005)
    await token.close()
    for transport in (one, other):
        await transport.close()
    assert list((deep / "test").iterdir()) == []


def test_the_realm_is_named_by_argument_environment_or_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROBOTREE_REALM", raising=False)
    assert realm_name(None) == "default"
    monkeypatch.setenv("ROBOTREE_REALM", "lab-2")
    assert realm_name(None) == "lab-2"
    assert realm_name("other") == "other"
    for bad in ("../x", "a/b", "-", "ä"):
        with pytest.raises(BadName):
            realm_name(bad)


def test_realms_lie_in_the_users_runtime_directory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert runtime_directory() == tmp_path / "robotree"
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert runtime_directory().name == f"robotree-{os.geteuid()}"


@pytest.fixture
def usual(place: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """The runtime directories of a login session and of everybody else, both empty."""
    login, shared = place / "user", place / "shared"
    monkeypatch.setattr(realms, "LOGIN", login)
    monkeypatch.setattr(realms, "SHARED", shared)
    session = login / str(os.geteuid())
    for folder in (session, shared):
        folder.mkdir(mode=0o700, parents=True)
    return session, shared


def founded_at_once(usual: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> list[Rendezvous]:
    """Have a process of a session and a service choose a folder before either is to be seen."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(usual[0]))
    session = Rendezvous("test")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    both = [session, Rendezvous("test")]
    assert len({one.directory for one in both}) == 2
    return both


def test_two_that_found_a_realm_at_once_in_two_folders_are_in_one_realm(
    usual: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their folders differ, and stay so: each looks into both."""
    places = founded_at_once(usual, monkeypatch)
    meshes = [Mesh(place) for place in places]
    for number, mesh in enumerate(meshes):
        mesh.open()
        mesh.announce(f"robot/r{number}/1")
    keys = ["robot/r0/1", "robot/r1/1"]
    latest = time.monotonic() + 60.0
    while not all(sorted(mesh.presence.keys("robot/*/*")) == keys for mesh in meshes):
        assert time.monotonic() < latest, "one of them does not see the other"
        time.sleep(0.005)
    assert [place.living() for place in places] == [{places[1].tag}, {places[0].tag}]
    found = [folder for folder in all_realms() if folder.is_relative_to(usual[0].parent.parent)]
    assert found == [min(place.directory for place in places)], "it is one realm"
    assert {*StopLine(realm="test").folders()} == {place.directory for place in places}
    for mesh in meshes:
        mesh.close().result(60.0)


def test_signs_of_life_are_read_and_files_removed_in_either_folder(
    usual: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    places = founded_at_once(usual, monkeypatch)
    doors = [place.register() for place in places]
    newcomer = Rendezvous("test", listed=False)
    for place, door in zip(places, doors, strict=True):
        beat = newcomer.beat_of(place.tag)
        assert beat is not None
        beat.close()
        door.close()
        newcomer.forget(place.tag)
        assert place.tag not in newcomer.others()


def test_the_other_folder_is_no_place_to_meet_if_somebody_else_can_enter_it(
    usual: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    places = founded_at_once(usual, monkeypatch)
    doors = [place.register() for place in places]
    places[1].directory.chmod(0o711)
    assert places[0].others() == []
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(usual[0]))
    assert realms.places(realm_folder("test")) == [places[0].directory]
    for door in doors:
        door.close()


def test_a_process_that_leaves_while_it_enters_leaves_nothing_behind(tmp_path: Path) -> None:
    """As `robotree watch` does whose reader has left already."""
    mesh = Mesh(place_at(tmp_path))
    enter = mesh._dial_all

    def leave_meanwhile(patience: float) -> None:
        mesh.close()
        enter(patience)

    mesh._dial_all = leave_meanwhile  # type: ignore[method-assign]
    mesh.open()
    mesh.close().result(60.0)
    assert names(mesh.place) == set()


class ByHand(Mesh):
    """A mesh without a thread: the test decides what it does next."""

    def __init__(self, folder: Path, tag: str) -> None:
        super().__init__(place_at(folder))
        self.place.tag = f"{os.getpid()}-{tag:0>8}"
        self.met: list[bool] = []
        """Each change of whether the other one is there."""
        self.waiting: list[tuple[What, int]] = []
        """What is ready and was not done yet."""
        self.presence.watch("robot/*/*", lambda _, there: self.met.append(there))

    def enter(self) -> None:
        self._enter()
        self.announce(f"robot/r{self.place.tag}/1")

    def dial(self) -> None:
        self._dial_all()

    def appear_or_vanish(self, key: str = "caller/here/1") -> None:
        (self.withdraw if key in self.presence.keys("caller/*/*") else self.announce)(key)

    def due(self) -> list[Callable[[], None]]:
        """What this one could do next, each in any order."""
        while self._to_flush:
            self._flush(self._to_flush.popleft())
        self.waiting += self._sockets.wait(0)
        return [partial(self._do, one) for one in self.waiting]

    def _do(self, one: tuple[What, int]) -> None:
        if one in self.waiting:  # else it was done when the far end was seen to have closed
            self.waiting.remove(one)
            self._serve_socket(*one)

    def end(self) -> None:
        self.place.leave()
        self._release()


@pytest.mark.parametrize("tags", ["ab", "ba"])
def test_two_that_dial_each_other_at_once_meet_in_whatever_order_their_greetings_come(
    tmp_path: Path, tags: str
) -> None:
    """One who is there looks into the folder just when a newcomer has its name and has not yet greeted."""
    for seed in range(60):
        chance = random.Random(seed)
        there, newcomer = ByHand(tmp_path, tags[0]), ByHand(tmp_path, tags[1])
        there.enter()
        there.met.clear()
        begin = newcomer._dial_all

        def dial_too(patience: float, begin: Callable[[float], None] = begin, there: ByHand = there) -> None:
            there.dial()
            begin(patience)

        newcomer._dial_all = dial_too  # type: ignore[method-assign]
        newcomer.enter()
        newcomer.met.clear()
        while due := [*there.due(), *newcomer.due()]:
            chance.choice(due)()
            if chance.random() < 0.3:
                newcomer.appear_or_vanish()
            newcomer._check_complete()
            assert newcomer.met or not newcomer._complete.is_set(), f"seed {seed}: it looked and saw nobody"
        assert (there.met, newcomer.met) == ([True], [True]), f"seed {seed}: they lost each other"
        seen, known = there.presence.keys("*/*/*"), newcomer.presence.keys("*/*/*")
        assert seen == known, f"seed {seed}: news overtook a greeting"
        for mesh in (there, newcomer):
            mesh.end()


def test_a_newcomer_waits_for_one_that_is_busy_and_not_for_one_that_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_module, "HANGS", 1e9)
    there = ByHand(tmp_path, "a")
    there.enter()

    def enter() -> tuple[Mesh, threading.Event]:
        newcomer, entered = Mesh(place_at(tmp_path)), threading.Event()
        threading.Thread(target=lambda: (newcomer.open(greeting=0.01), entered.set())).start()
        return newcomer, entered

    newcomer, entered = enter()
    assert not entered.wait(0.1), "it is busy: its last sign of life is new"
    while not entered.is_set():
        for step in there.due():
            step()
    assert newcomer.presence.keys("robot/*/*") == [f"robot/r{there.place.tag}/1"]
    newcomer.close().result(60.0)

    there.place.beat(time.monotonic() - RECENT)
    newcomer, entered = enter()
    assert entered.wait(10.0), "it hangs: its last sign of life is old"
    assert newcomer.presence.keys("robot/*/*") == []
    newcomer.close().result(60.0)
    there.end()
