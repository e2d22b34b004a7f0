"""The meeting place: whom it lets in, what it leaves behind, and what it says when it cannot be used."""

from __future__ import annotations

import asyncio
import os
import shutil
from pathlib import Path

import pytest

from robotree.vr.errors import BadName, RealmUnusable
from robotree.vr.network.local import join
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.rendezvous import Rendezvous, realm_name, runtime_directory


def place_at(folder: Path) -> Rendezvous:
    return Rendezvous("test", folder / "r")


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
    dead.hold("robot/a/1")
    with pytest.raises(ConnectionRefusedError):
        newcomer.dial(dead.tag)
    newcomer.forget(dead.tag)
    assert names(newcomer) == set()


def test_what_a_process_holds_can_be_read_without_asking_it(tmp_path: Path) -> None:
    one, other = place_at(tmp_path), place_at(tmp_path)
    door = one.register()
    for key in ("robot/a/1", "robot/b/1", "host/h/1"):
        one.hold(key)
    one.drop("robot/b/1")
    one.drop("robot/b/1")
    assert other.keys_of(one.tag) == ["robot/a/1", "host/h/1"]
    one.leave()
    one.hold("robot/c/1")
    assert other.keys_of(one.tag) == []
    door.close()


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
    assert place.keys_of(tag) == []
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


def test_a_process_is_registered_until_its_name_is_gone(tmp_path: Path) -> None:
    place = place_at(tmp_path)
    door = place.register()
    place.hold("robot/a/1")
    assert place.registered()
    shutil.rmtree(place.directory)
    assert not place.registered()
    door.close()
    door = place.register()
    assert place.registered()
    assert place.keys_of(place.tag) == ["robot/a/1"]
    door.close()


def test_the_place_is_private(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir(mode=0o755)
    place = Rendezvous("test", tmp_path / "r")
    assert place.directory.stat().st_mode & 0o777 == 0o700
    assert (tmp_path / "r").stat().st_mode & 0o777 == 0o700


def test_a_place_that_is_no_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("a file")
    with pytest.raises(RealmUnusable, match="set XDG_RUNTIME_DIR"):
        Rendezvous("test", tmp_path / "r")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a directory away")
def test_somebody_elses_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    os.chown(tmp_path / "r", 65534, 65534)
    with pytest.raises(RealmUnusable, match="belongs to somebody else"):
        Rendezvous("test", tmp_path / "r")


async def test_a_path_too_long_for_a_socket_is_no_obstacle(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 120)
    one, other = await join("test", root=deep), await join("test", root=deep)
    token = await one.announce("robot/a/1")
    async with asyncio.timeout(5):
        while not await other.present("robot/*/*"):  # noqa: ASYNC110 # the question is the thing examined
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


def test_a_process_that_leaves_while_it_enters_leaves_nothing_behind(tmp_path: Path) -> None:
    """As `robotree watch` does whose reader has left already."""
    mesh = Mesh(place_at(tmp_path))
    enter = mesh._dial_all

    def leave_meanwhile() -> None:
        mesh.close()
        enter()

    mesh._dial_all = leave_meanwhile  # type: ignore[method-assign]
    mesh.open()
    mesh._thread.join(10.0)
    assert mesh.close().done()
    assert names(mesh.place) == set()
