"""What needs a machine for the test alone: file systems that are full, and a stop of all realms of a user.

Each story runs in a process with mounts and a network of its own (`tests/apart.py`): it may fill `/tmp`, and
`robotree stop --everywhere` reaches nobody else's robots.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.errors import MemberFailed
from robotree.tui.processes.crew import Crew
from robotree.vr.base.errors import Hanging
from robotree.vr.network.realms import realm_folder
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until
from tests import apart
from tests.command_line import robotree

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("place")]
TMP, LOGIN = Path("/tmp"), Path("/run")  # noqa: S108 # of a process with mounts of its own
MOUNTS = (f"{TMP}=2m", f"{LOGIN}=2m")
"""With the modes that these folders have: everybody may write into `/tmp`."""
PAGE = '''"""Waiter: waits."""
from robotree.vr import VirtualRobot, command

class Waiter(VirtualRobot):
    """Waits."""

    @command
    def wait(self) -> None:
        """Wait for a minute."""
        self.sleep(60)
'''
FILL = """
import sys
with open("/tmp/theirs", "wb", buffering=0) as file:
    for size in (1 << 16, 1 << 12, 1):
        try:
            while file.write(bytes(size)):
                pass
        except OSError:
            pass
"""
"""What another user does."""
REALMS = (
    (TMP / "run", "default", "waiter-1"),
    (TMP / "run", "lab", "waiter-2"),
    (None, "lab", "waiter-3"),
)
"""`_realm` says what they mean."""
STORIES = (
    "full_shared_folder",
    "founded_at_once",
    "every_realm_is_stopped",
    "a_realm_that_hangs",
)


@pytest.mark.parametrize("story", STORIES)
def test_apart(story: str) -> None:
    if why := apart.reason():
        pytest.skip(why)
    done = apart.run(f"{__name__}:{story}", *MOUNTS)
    assert done.returncode == 0, done.stderr


# -- stories ---------------------------------------------------------------------------------------


async def full_shared_folder() -> None:
    """Without a runtime folder: another user fills `/tmp`, and has room elsewhere for us to split off to."""
    os.environ.pop("XDG_RUNTIME_DIR")
    os.environ["TMPDIR"] = str(LOGIN)

    def fill() -> Path:
        another = {"user": 65534, "group": 65534, "extra_groups": []} if os.geteuid() == 0 else {}
        python = "/usr/bin/python3" if Path("/usr/bin/python3").exists() else sys.executable
        subprocess.run([python, "-I", "-S", "-c", FILL], cwd="/", check=True, **another)
        assert os.statvfs(TMP).f_bfree == 0
        return TMP / "theirs"

    await _stop_while_full(TMP / f"robotree-{os.geteuid()}" / "default", fill)


async def founded_at_once() -> None:
    """Services and processes of a login session start at the same moment: they are in one realm."""
    session = LOGIN / "user" / str(os.geteuid())
    await asyncio.to_thread(session.mkdir, mode=0o700, parents=True)
    for number in range(3):
        async with Crew(f"realm-{number}", LOGIN) as crew:
            starting = list[Awaitable[object]]()
            for name, runtime in (("session", str(session)), ("service", "")):
                os.environ["XDG_RUNTIME_DIR"] = runtime  # of what is started next
                starting += [
                    asyncio.ensure_future(crew.start("host", f"host-{name}")),
                    asyncio.ensure_future(crew.start("lookup", f"lookup-{name}")),
                ]
                await asyncio.sleep(0)  # they have taken their environment
            await asyncio.gather(*starting)
            for runtime in (str(session), ""):
                os.environ["XDG_RUNTIME_DIR"] = runtime
                async with joined(f"realm-{number}") as realm_client:
                    await until(
                        lambda realm_client=realm_client: _both(realm_client.services),
                        "both lookup services are seen",
                    )
                    assert _both(host.address.name for host in await realm_client.hosts())


def _both(names: Iterable[str]) -> bool:
    return {name.partition("-")[2] for name in names} == {"session", "service"}


async def every_realm_is_stopped() -> None:
    """Realms with other names and in other folders: one line stops all, and names each."""
    async with AsyncExitStack() as ties:
        realms = [await ties.enter_async_context(_realm(*realm)) for realm in REALMS]
        done = _line("stop", "--realm", "nobody")
        assert done.returncode == exit_codes.NOBODY
        assert "--realm lab" in done.stderr, "where robots are is named"
        assert not any([await realm.stopped() for realm in realms])
        done = _line("stop", "--everywhere", "--json")
        assert done.returncode == exit_codes.DONE, done
        told = {(Path(one["folder"]), *one["stopped"]) for one in json.loads(done.stdout)["realms"]}
        assert told == {(realm.folder, realm.robot) for realm in realms}
        assert all([await realm.stopped() for realm in realms])


async def a_realm_that_hangs() -> None:
    """The process of one realm hangs: it is named, and the others have stopped."""
    async with AsyncExitStack() as ties:
        realms = [await ties.enter_async_context(_realm(*realm)) for realm in REALMS]
        first, hanging, third = realms
        os.kill(hanging.pid, signal.SIGSTOP)
        try:
            done = _line("stop", "--everywhere", "--json")
            assert done.returncode == exit_codes.NOBODY, done
            said = {Path(one["folder"]): one for one in json.loads(done.stdout)["realms"]}
            assert str(hanging.pid) in said[hanging.folder]["message"]
            assert [said[one.folder]["stopped"] for one in (first, third)] == [[first.robot], [third.robot]]
            assert await first.stopped()
            assert await third.stopped()
        finally:
            os.kill(hanging.pid, signal.SIGCONT)

        async def awake_and_stopped() -> bool:
            with suppress(Hanging):  # it is a moment until it is seen to beat again
                return await hanging.stopped()
            return False

        await until(awake_and_stopped, "it has stopped, too")


# -- helpers ---------------------------------------------------------------------------------------


@dataclass
class _Realm:
    folder: Path
    robot: str
    pid: int
    """Of the host in which its robot is."""
    realm_client: RealmClient

    async def stopped(self) -> bool:
        """Whether its robot has stopped."""
        return (await self.realm_client.describe(self.robot)).stopped


@asynccontextmanager
async def _realm(runtime: Path | None, name: str, robot: str) -> AsyncGenerator[_Realm]:
    """One realm with one robot; the variables of this process lead to it from now on.

    Args:
        runtime: the runtime folder of its processes; None: they have none.
        name: of the realm.
        robot: its name.
    """
    if runtime is None:
        os.environ.pop("XDG_RUNTIME_DIR", None)
    else:
        await asyncio.to_thread(runtime.mkdir, mode=0o700, exist_ok=True)
        os.environ["XDG_RUNTIME_DIR"] = str(runtime)
    page = LOGIN / "waiter.py"
    page.write_text(PAGE)
    async with Crew(name, LOGIN) as crew:
        host = await crew.start("host", f"host-{robot}")
        async with joined(name) as realm_client:
            await realm_client.create(str(page), robot)
            yield _Realm(realm_folder(name), robot, host.pid, realm_client)


def _line(*words: str) -> subprocess.CompletedProcess[str]:
    return robotree(*words)


async def _stop_while_full(folder: Path, fill: Callable[[], Path]) -> None:
    """Stop two robots while the file system of their realm is full, then let a newcomer in.

    Args:
        folder: of the realm.
        fill: fills the file system, and returns the file that does it.
    """
    page = LOGIN / "waiter.py" if folder.is_relative_to(TMP) else TMP / "waiter.py"
    page.write_text(PAGE)
    async with Crew("default", page.parent) as crew:
        rover = await crew.start("sim", "rover", "--listen", "tcp:127.0.0.1:0")
        await crew.start_all(("host", "host-1"), ("proxy", "rover", "rover-1", "--connect", rover.address))
        assert realm_folder("default") == folder
        async with joined("default") as realm_client:
            await realm_client.create(str(page), "waiter")
            full = fill()
            done = _line("stop", "--json")
            assert (done.returncode, set(json.loads(done.stdout)["stopped"])) == (
                exit_codes.DONE,
                {"rover-1", "waiter"},
            ), done
            assert [(await realm_client.describe(name)).stopped for name in ("rover-1", "waiter")] == [
                True,
                True,
            ]
            with pytest.raises(MemberFailed, match="No space left on device"):
                await crew.start("lookup", "lookup-1")
            assert _realms_of_this_user() == {folder}, "nobody split off"
            full.unlink()
            await crew.start("lookup", "lookup-2")
            assert _realms_of_this_user() == {folder}
            await until(lambda: "lookup-2" in realm_client.services, "it is seen")
            done = _line("resume", "--json")
            assert set(json.loads(done.stdout)["resumed"]) == {"rover-1", "waiter"}, done


def _realms_of_this_user() -> set[Path]:
    """Return all folders that are realms, wherever a process may have put them."""
    return {path.parent for top in (TMP, LOGIN) for path in top.rglob("*.sock")}
