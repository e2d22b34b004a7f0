"""Robots in processes of their own: what they do wrong harms nobody else, and a crash is survived.

The processes are real ones, made by the zygote; the host lives in the process of the test.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.line import away
from robotree.vr.agents.host import Host
from robotree.vr.agents.run import kept_by
from robotree.vr.base.address import Address, everyone
from robotree.vr.base.errors import (
    CommandFailed,
    DuplicateName,
    GivenUp,
    NotApart,
    NotConfirmed,
    NotIsolated,
    VrError,
)
from robotree.vr.base.permissions import Isolation
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import ReadEvents
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Clearance, Gate
from robotree.vr.bundle.loader import LIMIT
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.isolation import apart
from robotree.vr.isolation.apart import ApartSetting, RobotsApart
from robotree.vr.isolation.nursery import BOX
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.kept import leave_stop, stop_left
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of
from tests.waiting import PATIENCE, until

PACKAGE = apart.__file__
"""A file that each robot may read."""
PAGE = str(Path(__file__).with_name("pages.py"))
SOURCE = Path(PAGE).read_text(encoding="utf-8")


def robot_of(operator: LocalTransport, name: str) -> RobotClient:
    address = Address.parse(operator.presence.keys(everyone("robot", name))[0])
    assert address is not None
    return RobotClient(operator, address)


class Place:
    """A host in this process, in a realm of this test alone; it may be started again."""

    host: Host

    def __init__(self, folder: Path, root: Path, name: str = "h1") -> None:
        self.folder, self.root, self.name = folder, root, name

    async def start(self) -> None:
        self.transport = await join("test", root=self.root)
        runner = runner_of(asyncio.get_running_loop())
        self.journal = HostJournal(self.folder / self.name, runner)
        process: Process[Any] = Process(runner, self.journal)
        way = kept_by(self.journal, process, self.transport)
        self.host = Host(way, self.name, process=process, journal=self.journal)
        setting = ApartSetting(self.name, "test", 5.0, 10.0, LIMIT, self.folder / self.name)
        self.host.apart = RobotsApart(setting, way)
        await self.host.start()
        await self.host.restore()

    async def end(self) -> None:
        await self.host.close()
        self.journal.close()
        await self.transport.close()

    async def restart(self) -> None:
        await self.end()
        await self.start()

    async def create(
        self, name: str = "guest", level: Isolation = "process", page: str = PAGE
    ) -> RobotClient:
        bundle = await asyncio.to_thread(Bundle.read, page)
        robot = await HostClient(self.operator, self.host.address).create(bundle, name, None, level)
        return RobotClient(self.operator, robot.address)

    def robot(self, name: str = "guest") -> RobotClient:
        return robot_of(self.operator, name)

    operator: LocalTransport

    def pid(self, name: str = "guest") -> int:
        assert self.host.apart is not None
        return self.host.apart.robots[name].pid

    def is_given_up(self, name: str = "guest") -> bool:
        assert self.host.apart is not None
        return self.host.apart.robots[name].given_up is not None

    async def crash_now(self) -> None:
        """End its process for the last time; returns when it is given up."""
        os.kill(self.pid(), signal.SIGKILL)
        await until(self.is_given_up)

    async def crash(self, guest: RobotClient) -> None:
        """End its process once it answers; returns when the host has seen that."""
        assert await guest.call("add", {"a": 1, "b": 2}) == 3
        before = self.pid()
        os.kill(before, signal.SIGKILL)
        await until(lambda: self.pid() != before)


@pytest.fixture
async def place(tmp_path: Path, place: Path) -> AsyncIterator[Place]:
    here = Place(tmp_path, place / "robotree")
    await here.start()
    here.operator = await join("test", root=here.root)
    yield here
    await here.operator.close()
    await here.end()


@pytest.fixture
def shared_memory() -> Iterator[int]:
    """A segment of System V that another program of the same user has."""
    libc = ctypes.CDLL(None, use_errno=True)
    segment: int = libc.shmget(0, 4096, 0o600)
    assert segment >= 0
    yield segment
    libc.shmctl(segment, 0, None)  # IPC_RMID


async def test_a_guest_can_be_called_and_can_do_no_harm(
    place: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shared_memory: int
) -> None:
    monkeypatch.chdir(tmp_path)  # where a host was started nobody may read
    monkeypatch.setenv("TOKEN_OF_SOMETHING", "of the host")
    guest = await place.create()
    secret = tmp_path / "secret"
    secret.write_text("42")
    assert await guest.call("add", {"a": 1, "b": 2}) == 3
    assert await guest.call("pid", {}) == place.pid() != os.getpid()
    assert await guest.call("attempt", {"what": "thread"}) == "ran"
    for what, where, refusal in (
        ("fork", "", "PermissionError"),
        ("execute", "", "PermissionError"),
        ("dial", "", "PermissionError"),
        ("signal", str(os.getpid()), "PermissionError"),
        ("read", str(secret), "PermissionError"),
        ("write", str(tmp_path / "new"), "PermissionError"),
        ("read", "/etc/shadow", "PermissionError"),
        ("open_up", str(secret), "PermissionError"),
        ("date", str(secret), "PermissionError"),
        ("date_through", PACKAGE, "PermissionError"),
        ("open_up_through", PACKAGE, "PermissionError"),
        ("freeze", PACKAGE, "PermissionError"),
        ("read", f"/proc/{os.getpid()}/environ", "PermissionError"),
        ("read", str(Path(__file__)), "PermissionError"),
        ("slow", str(os.getpid()), "PermissionError"),
        ("memory", "", "PermissionError"),
        ("stay", "", "PermissionError"),
        ("send", str(tmp_path / "socket"), "PermissionError"),
        ("attach", str(shared_memory), "PermissionError"),
        ("look_on", str(tmp_path), "PermissionError"),
        ("eat", "", "MemoryError"),
    ):
        assert await guest.call("attempt", {"what": what, "where": where}) == refusal, what
    assert not (tmp_path / "new").exists()
    seen = await guest.call("attempt", {"what": "environment"})
    assert "PATH" in seen
    assert "of the host" not in seen
    assert [robot.name for robot in place.host.description().robots] == ["guest"]
    assert place.host.description().pages["guest"]


LIMITED = """# /// script
# [tool.robotree.permissions]
# commands = ["Guest.add"]
# ///
"""


async def test_it_commands_whom_somebody_has_put_under_it(place: Place, tmp_path: Path) -> None:
    page = tmp_path / "limited.py"
    page.write_text(LIMITED + SOURCE)
    guest, helper = await place.create(), await place.create("helper")
    limited, other = await place.create("limited", page=str(page)), await place.create("other")
    with pytest.raises(VrError, match="helper"):
        await guest.call("add_by_helper", {"a": 1, "b": 2})
    for above, below in ((guest, helper), (limited, other)):
        await above.enslave("helper", below.address)
        assert await above.call("add_by_helper", {"a": 1, "b": 2}) == 3
    assert place.pid("limited") > 0, "it has not been ended"
    for _ in range(2):
        await guest.safe_stop("a person says so")
        assert (await helper.describe()).stopped
        assert set(await guest.resume()) == {"guest", "helper"}
        assert not (await helper.describe()).stopped
    assert await guest.call("add_by_helper", {"a": 1, "b": 2}) == 3
    apart_ = place.host.apart
    assert apart_ is not None
    kept = {each.create.name: each.children for each in apart_.kept()}  # for its next process
    assert kept == {"guest": ("helper",), "helper": (), "limited": ("other",), "other": ()}
    apart_.robots["guest"]._judge.children.clear()  # pyright: ignore[reportPrivateUsage] # as if it had forged the bond
    with pytest.raises(VrError, match="nobody has put helper under it"):
        await guest.call("add_by_helper", {"a": 1, "b": 2})


async def test_a_command_goes_on_after_a_crash_and_ends_after_a_second_one(place: Place) -> None:
    guest = await place.create()
    first, mark = place.pid(), place.folder / "h1" / "apart" / "guest" / "mark"
    assert await guest.call("crash_once", {"mark": str(mark)}) == "done"
    assert place.pid() != first
    with pytest.raises(CommandFailed, match="has ended in it twice"):
        await guest.call("crash", {})
    assert await guest.call("add", {"a": 1, "b": 1}) == 2


async def test_one_that_is_given_up_says_why_until_it_is_deleted_and_can_be_made_again(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "GIVES_UP", 2)
    guest = await place.create()
    for _ in range(2):
        await place.crash(guest)
    with pytest.raises(GivenUp, match=r"ended its process 2 times \(SIGKILL\)\. Mend the page; then"):
        await guest.call("add", {"a": 1, "b": 1})
    described = await guest.describe()
    assert not described.online
    assert described.attributes["condition"].startswith("given up: its page has ended")
    assert [robot.name for robot in place.host.description().robots] == ["guest"]
    await guest.safe_stop("a person says so")
    with pytest.raises(DuplicateName):
        await place.create()
    with pytest.raises(GivenUp):
        await place.host.migrate_apart("guest", "h2")
    # its host goes on with it when it is started again
    await place.restart()
    assert "guest" in await guest.resume()
    for _ in range(2):
        await place.crash(guest)
    with pytest.raises(GivenUp):
        await guest.call("add", {"a": 1, "b": 1})
    await guest.delete()
    await until(lambda: not place.host.description().robots)
    assert await (await place.create()).call("add", {"a": 2, "b": 2}) == 4


async def test_what_is_ordered_while_it_is_given_up_holds_when_its_host_is_back(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "GIVES_UP", 1)
    marks: dict[str, Path] = {}
    for name in ("free", "stopped", "cancelled"):
        guest = await place.create(name)
        marks[name] = place.folder / "h1" / "apart" / name / "mark"
        await guest.tell("crash_and_go_on", {"mark": str(marks[name])}, deadline=3600.0)
        await until(lambda name=name: place.is_given_up(name))
    await place.robot("stopped").safe_stop("a person says so")
    assert (await place.robot("stopped").describe()).stop_reason == "a person says so"
    await place.robot("cancelled").cancel()
    await place.restart()
    await until(lambda: marks["free"].read_text() == "went on")  # as it is said: it goes on from there
    assert [(await place.robot(name).describe()).stopped for name in marks] == [False, True, False]
    with pytest.raises(VrError, match="a person says so"):
        await place.robot("stopped").call("add", {"a": 1, "b": 2})
    await place.robot("stopped").resume()
    for name in ("stopped", "cancelled"):
        assert await place.robot(name).call("add", {"a": 1, "b": 2}) == 3, "nothing else goes on"
        assert marks[name].read_text() == "begun"
    await place.restart()  # and what was resumed is not stopped again
    assert await place.robot("stopped").call("add", {"a": 1, "b": 2}) == 3


async def test_a_stop_that_cannot_be_kept_is_not_confirmed(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(apart, "GIVES_UP", 1)
    guest = await place.create()
    await place.crash_now()
    monkeypatch.setattr(apart, "replace", refuse)
    for asking in (guest.safe_stop("a person says so"), guest.cancel()):
        with pytest.raises(NotConfirmed, match="it goes on when h1 is started again: No space left"):
            await asking


async def test_a_command_that_had_it_given_up_has_ended_when_its_host_is_back(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "GIVES_UP", 2)
    guest = await place.create()
    with pytest.raises(VrError):
        await guest.call("crash", {})
    await until(place.is_given_up)
    await place.restart()
    pid = place.pid()
    assert await guest.call("add", {"a": 1, "b": 2}) == 3
    assert place.pid() == pid


async def test_a_damaged_journal_is_named_and_outlasts_a_new_robot_of_its_name(
    place: Place, caplog: pytest.LogCaptureFixture
) -> None:
    await place.create()
    await place.end()
    folder = place.folder / "h1" / "apart" / "guest"
    segment = next(path for path in sorted(folder.rglob("*")) if path.is_file() and path.stat().st_size > 200)
    damaged = bytearray(segment.read_bytes())
    damaged[100] ^= 0xFF
    segment.write_bytes(damaged)
    await place.start()
    assert "guest is not back: " in caplog.text
    assert "is damaged at byte" in caplog.text
    assert await (await place.create()).call("add", {"a": 1, "b": 2}) == 3
    aside = folder.with_name("guest.1")
    assert (aside / segment.relative_to(folder)).read_bytes() == damaged
    assert f"is in {aside}" in caplog.text
    await place.restart()
    assert await place.robot().call("add", {"a": 1, "b": 2}) == 3
    await place.end()
    folder.with_name("guest.page").unlink()
    await place.start()
    assert "guest is not back: its page is missing" in caplog.text
    await place.create()
    assert folder.with_name("guest.2").is_dir()


async def test_who_holds_the_interpreter_harms_itself_alone(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "SILENT", 2.0)
    guest = await place.create()
    other = await place.create("other")
    holding = asyncio.ensure_future(guest.call("hold", {"seconds": 600}))
    assert await other.call("add", {"a": 2, "b": 2}) == 4
    with pytest.raises(CommandFailed, match="held the interpreter"):
        async with asyncio.timeout(PATIENCE):
            await holding
    assert await guest.call("add", {"a": 1, "b": 1}) == 2


async def test_a_command_that_ignores_every_cancel_is_ended_with_its_process_and_that_is_said(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "STUBBORN", 0.5)
    guest = await place.create()
    first, mark = place.pid(), place.folder / "h1" / "apart" / "guest" / "mark"
    defying = asyncio.ensure_future(guest.call("defy", {"mark": str(mark)}, key="defying"))
    await until(mark.exists)
    await guest.cancel("defying", reason="enough")
    with pytest.raises(VrError):
        async with asyncio.timeout(PATIENCE):
            await defying
    await until(lambda: place.pid() not in (0, first))
    assert await guest.call("add", {"a": 2, "b": 2}) == 4
    said = await guest.read_log()
    assert any("defy went on after it was ended, so its process was ended" in line.text for line in said)


async def test_a_stop_that_was_left_for_a_process_that_hung_holds_in_the_next_one(
    place: Place, tmp_path: Path
) -> None:
    guest = await place.create()
    assert leave_stop(tmp_path / "h1" / "apart" / "guest", [], "halt") == ("guest",)
    before = place.pid()
    os.kill(before, signal.SIGKILL)
    await until(lambda: place.pid() not in (0, before))
    assert (await guest.describe()).stop_reason == "halt, while its process could not be reached"
    await guest.resume()
    assert await guest.call("add", {"a": 1, "b": 2}) == 3


async def test_a_stop_that_was_left_while_its_host_hung_holds_when_it_is_back(
    place: Place, tmp_path: Path
) -> None:
    """It goes on, and writes its log, while its host hangs, and then both are killed."""
    guest = await place.create()
    folder, pid = tmp_path / "h1" / "apart" / "guest", place.pid()
    assert leave_stop(folder, ["guest"], "halt") == ()
    assert leave_stop(folder, [], "halt") == ("guest",)
    assert await guest.call("add", {"a": 1, "b": 2}) == 3
    await place.end()
    await until(lambda: not _runs(pid))
    await place.start()
    assert (await guest.describe()).stop_reason == "halt, while its host was away"
    events = await place.host.answer(_request(ReadEvents(robot="guest")))
    assert events.events  # type: ignore[union-attr] # `EventsRead`
    await guest.resume()
    await place.restart()
    assert not (await guest.describe()).stopped, "the stop is over"
    assert leave_stop(folder, [], "halt") == ("guest",)
    await guest.delete()
    await until(lambda: leave_stop(folder, [], "halt") == ())  # there is nobody any more
    await until(lambda: not list(folder.parent.iterdir()))
    await place.create()
    await place.restart()
    assert not (await place.robot().describe()).stopped, "it was another one's"


def test_a_stop_of_everything_is_left_for_each_robot_apart_and_says_at_which_host(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    folder = tmp_path / "robotree" / "test" / "hosts" / "h1" / "apart"
    folder.mkdir(parents=True, mode=0o700)
    for name in ("guest", "other"):
        (folder / f"{name}.page").write_bytes(b"")
    assert away.leave_stop("test", ["other"], []) == ["guest will be stopped when host h1 is back"]
    assert stop_left(folder / "guest")
    away.take_stop_back("test", "other")
    assert stop_left(folder / "guest"), "it is another one that is resumed"
    away.take_stop_back("test", "guest")
    assert not stop_left(folder / "guest")
    assert away.leave_stop_apart("test", ["guest", "elsewhere"]) == [
        "guest will be stopped when its process is started again"
    ]
    assert stop_left(folder / "guest")


async def test_it_is_ended_for_good_when_it_forges(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    from robotree.vr.isolation import judge

    guest = await place.create()
    monkeypatch.setitem(judge.ALLOWED, "lookup", ())  # what it does is what no robot does
    registry = await join("test", root=place.root)
    try:
        await registry.announce("lookup/l1/1")  # its registrar asks there
        await until(lambda: not place.host.description().robots)
    finally:
        await registry.close()
    with pytest.raises(VrError):
        await guest.call("add", {"a": 1, "b": 1})


async def test_a_process_that_cannot_be_is_said_to_who_asks(place: Place, tmp_path: Path) -> None:
    broken = tmp_path / "broken.py"
    broken.write_text("raise ValueError('not today')\n")
    bundle = Bundle.read(broken)
    client = HostClient(place.operator, place.host.address)
    with pytest.raises(VrError, match="not today"):
        await client.create(bundle, "broken", None, "process")
    assert not place.host.description().robots
    robots, place.host.apart = place.host.apart, None
    with pytest.raises(NotIsolated):
        await client.create(bundle, "broken", None, "process")
    place.host.apart = robots


async def test_without_bubblewrap_a_sandbox_is_refused_and_nothing_less_is_taken(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "BOX", None)
    with pytest.raises(NotIsolated, match="bubblewrap is not installed"):
        await place.create(level="sandbox")
    assert not place.host.description().robots


@pytest.mark.skipif(BOX is None, reason="bubblewrap is not installed")
async def test_in_a_sandbox_there_are_no_folders_of_anybody(place: Place, tmp_path: Path) -> None:
    guest = await place.create(level="sandbox")
    secret = tmp_path / "secret"
    secret.write_text("42")
    assert await guest.call("add", {"a": 1, "b": 2}) == 3
    assert await guest.call("pid", {}) != place.pid()  # it counts from 1, and knows of no others
    for what, where, refusal in (
        ("read", str(secret), "FileNotFoundError"),
        ("fork", "", "PermissionError"),
        ("dial", "", "PermissionError"),
        ("signal", str(os.getpid()), "PermissionError"),
        ("eat", "", "MemoryError"),
    ):
        assert await guest.call("attempt", {"what": what, "where": where}) == refusal, what
    pid = place.pid()
    with pytest.raises(CommandFailed, match="has ended in it twice"):
        await guest.call("crash", {})
    assert place.pid() != pid
    assert await guest.call("add", {"a": 1, "b": 1}) == 2


async def test_a_page_has_its_helpers_and_a_place_for_files_that_nobody_keeps(
    place: Place, tmp_path: Path
) -> None:
    helped = tmp_path / "helped.py"
    (tmp_path / "helper.py").write_text("WORD = 'helped'\n")
    helped.write_text(
        "import tempfile\nfrom pathlib import Path\nfrom helper import WORD\n"
        "from robotree.vr import VirtualRobot, command\n\n\n"
        "class Helped(VirtualRobot):\n    @command\n    def say(self) -> str:\n"
        "        with tempfile.NamedTemporaryFile(delete=False) as file:\n"
        "            return f'{WORD} {file.name}'\n"
    )
    bundle = await asyncio.to_thread(Bundle.read, helped)
    client = HostClient(place.operator, place.host.address)
    robot = RobotClient(place.operator, (await client.create(bundle, "helped", None, "process")).address)
    word, file = (await robot.call("say", {})).split()
    assert word == "helped"
    assert file.startswith(str(place.folder / "h1" / "apart" / "helped"))


async def test_a_page_that_must_be_kept_apart_replaces_none_that_is_not(place: Place) -> None:
    bundle = Bundle.read(PAGE)
    client = HostClient(place.operator, place.host.address)
    own = await client.create(bundle, "own")
    place.host.gate = _Strict()
    with pytest.raises(NotApart):
        await client.reload(bundle, "own")
    assert await RobotClient(place.operator, own.address).call("add", {"a": 1, "b": 1}) == 2
    guest = await place.create()
    await client.reload(bundle, "guest")
    assert await guest.call("add", {"a": 1, "b": 1}) == 2


class _Strict(Gate):
    """The gate of a host that trusts the signer of each page only in a process."""

    def admit(self, bundle: Bundle, asker: Principal, host: str) -> Clearance:
        del bundle, asker, host
        return Clearance("anna", None, "process")


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"


def _request(request: ReadEvents) -> Any:
    from robotree.vr.base.envelope import Received
    from robotree.vr.base.principal import principal_of, this_process

    return Received(request, principal_of(this_process(), "", ""), 0.0, 60.0)
