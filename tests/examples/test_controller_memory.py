"""What the controllers of the examples remember over a restart: no damage makes them obey an older lease."""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from robotree.protocol.messages import Goal, GoalState, GoalStatus, Mode, ModeKind, SetMode, Verb
from tests.examples.controllers import Running, started
from tests.station import Station

pytestmark = pytest.mark.e2e
EPOCH = 1000
NAN = (float("nan"),) * 7


@pytest.fixture(params=["c", "python"])
def program(request: pytest.FixtureRequest, controller_c: Path, controller_py: list[str]) -> list[str]:
    return [str(controller_c)] if request.param == "c" else controller_py


@pytest.fixture
def memory(tmp_path: Path) -> Path:
    return tmp_path / "memory"


@contextmanager
def running(program: list[str], memory: Path, *options: str) -> Iterator[Running]:
    with started([*program, "0", "--memory", memory, *options]) as controller:
        yield controller


async def obeys(controller: Running, epoch: int) -> None:
    """Have a goal obeyed under an epoch."""
    station = await Station().dial(controller.url)
    station.say(Goal(epoch, epoch, 0, NAN, Verb.HOLD, 1, 1))
    await station.told(GoalStatus, key=epoch, state=GoalState.SUCCEEDED, epoch=epoch)
    station.link.close()


async def epoch_of(controller: Running) -> int:
    """The highest epoch that it says it has obeyed."""
    station = await Station().dial(controller.url)
    told = await station.told(Mode)
    station.link.close()
    assert isinstance(told, Mode)
    return told.epoch


@pytest.fixture
async def used(program: list[str], memory: Path) -> Path:
    """The memory of a controller that has obeyed an epoch and was killed."""
    with running(program, memory, "--reset-epoch") as controller:
        await obeys(controller, EPOCH - 5)
        await obeys(controller, EPOCH)
        controller.process.kill()
        controller.process.wait()
    return memory


def copy_of(memory: Path) -> Path:
    return memory.with_name(f"{memory.name}.copy")


def flip(path: Path, chance: random.Random) -> None:
    """Flip one bit."""
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def content(path: Path) -> bytes:
    return path.read_bytes()


def damage(path: Path, how: str, whole: bytes) -> None:
    """Damage a file that had this content."""
    match how:
        case "removed":
            path.unlink()
        case "flipped":
            flip(path, random.Random(how))
        case _:
            path.write_bytes({"emptied": b"", "cut": whole[:-9], "old": whole}[how])


def refuses(program: list[str], memory: Path) -> str:
    words = [*program, "0", "--memory", str(memory)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1, done
    assert "ready" not in done.stdout
    return done.stderr


async def test_what_was_obeyed_outlives_a_kill(program: list[str], used: Path) -> None:
    with running(program, used) as controller:
        assert await epoch_of(controller) == EPOCH
        assert controller.complaints() == ""


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("which", ["the file", "its copy"])
async def test_a_flipped_bit_is_reported_and_lowers_nothing(
    program: list[str], used: Path, seed: int, which: str
) -> None:
    damaged = used if which == "the file" else copy_of(used)
    flip(damaged, random.Random(seed))
    with running(program, used) as controller:
        assert await epoch_of(controller) == EPOCH
        assert f"{damaged} is damaged or missing" in controller.complaints()
        controller.process.kill()
        controller.process.wait()
    with running(program, used) as controller:
        assert controller.complaints() == "", "it was mended"


@pytest.mark.parametrize("how", ["removed", "emptied", "cut", "old"])
async def test_a_copy_that_is_lost_or_old_is_replaced_by_the_other_one(
    program: list[str], used: Path, how: str
) -> None:
    whole = content(used)
    if how == "old":
        with running(program, used) as controller:
            await obeys(controller, EPOCH + 1)
    damage(used, how, whole)
    with running(program, used) as controller:
        assert await epoch_of(controller) == EPOCH + (how == "old")
        assert ("damaged or missing" in controller.complaints()) == (how != "old")


@pytest.mark.parametrize("how", ["flipped", "removed", "emptied"])
async def test_with_both_lost_it_does_not_start_until_a_person_says_so(
    program: list[str], used: Path, how: str
) -> None:
    for path in (used, copy_of(used)):
        damage(path, how, content(path))
    for _ in range(2):
        assert "start it once with --reset-epoch" in refuses(program, used)
    with running(program, used, "--reset-epoch") as controller:
        assert await epoch_of(controller) == 0
        controller.process.kill()
        controller.process.wait()
    with running(program, used) as controller:
        assert controller.complaints() == ""


def test_the_very_first_start_is_a_person_s_too(program: list[str], memory: Path) -> None:
    assert "as at its very first start" in refuses(program, memory)


async def test_two_controllers_never_share_a_memory(program: list[str], used: Path) -> None:
    with running(program, used):
        assert "of another controller that runs" in refuses(program, used)


async def test_a_full_disk_keeps_no_stop_from_being_obeyed(program: list[str], used: Path) -> None:
    """Nor does it matter that nobody can be told: standard error is a file, too."""
    with running(program, used) as controller:
        _, hard = resource.prlimit(controller.process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(controller.process.pid, resource.RLIMIT_FSIZE, (0, hard))
        station = await Station().dial(controller.url)
        station.say(SetMode(EPOCH + 1, 1, 1, ModeKind.READY))
        station.say(SetMode(0, 1, 1, ModeKind.SAFE_STOP))
        stopped = await station.told(Mode, mode=ModeKind.SAFE_STOP)
        assert isinstance(stopped, Mode)
        assert stopped.epoch == EPOCH + 1
        station.link.close()
        os.kill(controller.process.pid, signal.SIGKILL)
        controller.process.wait()
