"""The meeting place: whom it lets in, what it leaves behind, and what it says when it cannot be used."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from robotree.vr.errors import BadName, RealmUnusable
from robotree.vr.network.rendezvous import LONGEST_SOCKET, Rendezvous, realm_name, runtime_directory
from robotree.vr.network.zenoh import join


def test_a_newcomer_sees_all_who_came_before_and_none_who_left(tmp_path: Path) -> None:
    first, second, third = (Rendezvous("test", tmp_path / "r") for _ in range(3))
    for place, expected in ((first, []), (second, [first.locator])):
        with place.door() as neighbours:
            assert neighbours == expected
            place.enter()
    first.leave()
    first.leave()
    with third.door() as neighbours:
        assert neighbours == [second.locator]
    second.leave()


def test_the_entry_of_the_dead_is_swept_out_with_its_socket(tmp_path: Path) -> None:
    dead, newcomer = Rendezvous("test", tmp_path / "r"), Rendezvous("test", tmp_path / "r")
    (tmp_path / "r/test/dead.entry").write_text(f"unixsock-stream/{tmp_path}/r/test/dead")
    (tmp_path / "r/test/empty.entry").write_text("")
    (tmp_path / "r/test/liar.entry").write_text(f"unixsock-stream/{tmp_path}/precious")
    (tmp_path / "precious").write_text("kept")
    for name in ("dead", "dead.lock"):
        (tmp_path / "r/test" / name).touch()
    with newcomer.door() as neighbours:
        assert neighbours == []
    assert [path.name for path in dead.directory.iterdir()] == [".door"]
    assert (tmp_path / "precious").read_text() == "kept"


def test_what_a_process_holds_is_known_to_others_until_it_leaves(tmp_path: Path) -> None:
    one, other = Rendezvous("test", tmp_path / "r"), Rendezvous("test", tmp_path / "r")
    for place in (one, other):
        with place.door():
            place.enter()
    for key in ("robot/a/1", "robot/b/1", "host/h/1"):
        one.hold(key)
    one.let_go("robot/b/1")
    assert other.held() == one.held() == {"robot/a/1": os.getpid(), "host/h/1": os.getpid()}
    one.leave()
    one.hold("robot/c/1")
    assert other.held() == {}
    other.leave()
    assert [path.name for path in other.directory.iterdir()] == [".door"]


def test_who_only_looks_leaves_the_entries_of_the_dead_to_the_next_who_enters(tmp_path: Path) -> None:
    """An entry that nobody holds may be that of a process which is just entering."""
    place = Rendezvous("test", tmp_path / "r")
    (tmp_path / "r/test/7-dead.entry").write_text(f"unixsock-stream/{tmp_path}/r/test/7-dead")
    (tmp_path / "r/test/7-dead.held").write_text("robot/a/1")
    assert place.held() == {}
    assert (tmp_path / "r/test/7-dead.entry").exists()
    with place.door():
        pass
    assert [path.name for path in place.directory.iterdir()] == [".door"]


def test_a_door_that_stays_locked_names_who_holds_it(tmp_path: Path) -> None:
    one, other = Rendezvous("test", tmp_path / "r"), Rendezvous("test", tmp_path / "r")
    held = pytest.raises(RealmUnusable, match=f"process {os.getpid()} has held the door")
    with one.door(), held, other.door(limit=0.05):
        pass
    with other.door(limit=0.05):
        pass


def test_the_place_is_private(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir(mode=0o755)
    place = Rendezvous("test", tmp_path / "r")
    assert place.directory.stat().st_mode & 0o777 == 0o700
    assert (tmp_path / "r").stat().st_mode & 0o777 == 0o700


def test_a_place_that_is_no_directory_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r").write_text("a file")
    with pytest.raises(RealmUnusable, match="set XDG_RUNTIME_DIR"):
        Rendezvous("test", tmp_path / "r")
    (tmp_path / "target").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "target")
    with pytest.raises(RealmUnusable, match="is not a directory"):
        Rendezvous("test", tmp_path / "link")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a directory away")
def test_somebody_elses_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r").mkdir()
    os.chown(tmp_path / "r", 65534, 65534)
    with pytest.raises(RealmUnusable, match="belongs to somebody else"):
        Rendezvous("test", tmp_path / "r")


async def test_a_path_too_long_for_a_socket_is_no_obstacle(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * LONGEST_SOCKET)
    place = Rendezvous("test", deep)
    assert len(str(place.socket)) <= LONGEST_SOCKET
    one, other = await join("test", root=deep), await join("test", root=deep)
    token = await one.announce("robot/a/1")
    seen: list[str] = []
    await other.watch("robot/*/*", lambda key, _: seen.append(key))
    await token.close()
    for transport in (one, other):
        socket = transport.session.socket
        assert socket.exists()
        await transport.close()
        assert not socket.exists()


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
