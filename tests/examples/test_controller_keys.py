"""The controllers of the examples with keys, and their memory: who has the key is obeyed, no recording is."""

from __future__ import annotations

import asyncio
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path

import pytest

from robotree.protocol.errors import LinkError
from robotree.protocol.links.keyring import create
from robotree.protocol.links.url import connect
from robotree.protocol.messages import AnyMessage, Goal, GoalState, GoalStatus, Mode, ModeKind, SetMode, Verb
from robotree.protocol.testing import RecordingHandler
from robotree.vr.world.testing import until
from tests.command_line import ROBOTREE
from tests.examples.controllers import COMPILER, Running, started
from tests.scenarios.test_keys import Operator
from tests.sim.test_server_keys import Punctual
from tests.station import Station

pytestmark = pytest.mark.e2e
GOLDEN = Path(__file__).parents[1] / "protocol" / "golden" / "controller_keys.json"
NAN = (math.nan,) * 4
NAME = "rover-1"
Start = Callable[..., AbstractContextManager[Running]]
ORDERS: list[AnyMessage] = [
    SetMode(3, 1, 1, ModeKind.READY),
    Goal(77, 3, 0, (0.3, 0.2, 0.4, *NAN), Verb.MOVE, 1, 1),
    SetMode(3, 1, 1, ModeKind.SAFE_STOP),
    SetMode(3, 1, 1, ModeKind.READY),
    Goal(78, 3, 0, (0.1, 0.2, 0.4, *NAN), Verb.MOVE, 1, 1),
]
CLOCK = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <time.h>
int clock_gettime(clockid_t id, struct timespec *t) {
    typedef int (*clock_fn)(clockid_t, struct timespec *);
    int failed = ((clock_fn)dlsym(RTLD_NEXT, "clock_gettime"))(id, t);
    if (id == CLOCK_REALTIME) t->tv_sec += atol(getenv("CLOCK_OFFSET"));
    return failed;
}
"""


@pytest.fixture(params=["c", "python"])
def program(request: pytest.FixtureRequest, controller_c: Path, controller_py: list[str]) -> list[str]:
    return [str(controller_c)] if request.param == "c" else controller_py


@pytest.fixture
def key(tmp_path: Path) -> Path:
    create(tmp_path / "cell.key")
    return tmp_path / "cell.key"


@pytest.fixture
def start(program: list[str], key: Path, tmp_path: Path) -> Start:
    """Starts a controller, by its name; under the same name it is the same one again."""

    def begin(
        name: str = NAME, *, key: Path = key, env: dict[str, str] | None = None
    ) -> AbstractContextManager[Running]:
        memory = tmp_path / f"memory of {abs(hash(name))}"
        words = ["--memory", str(memory), "--key", str(key), "--name", name]
        first = [] if memory.exists() else ["--reset-epoch"]
        return started([*program, "0", *words, *first], env)

    return begin


def named(running: Running, name: str = NAME) -> str:
    return f"{running.url}?controller={name}"


async def drive(running: Running, key: Path, name: str = NAME) -> Operator:
    """Give a controller all orders, with the key; what was sent is kept."""
    operator = await Operator(key, 7).dial(named(running, name))
    for order in ORDERS:
        operator.say(order)
        await asyncio.sleep(0.05)
    await until(lambda: operator.latest() == ModeKind.ACTIVE, "it obeys who has the key")
    return operator


async def replay(running: Running, frames: list[bytes]) -> None:
    """Send frames as they were recorded, and wait until they were read."""
    ended = asyncio.Event()

    class Attacker(RecordingHandler):
        def closed(self, reason: LinkError) -> None:
            super().closed(reason)
            ended.set()

    link = await connect(running.url, Attacker)
    for frame in frames:
        link.send(frame)
    await until(lambda: "refused: a frame of 255" in running.complaints(), "it refuses them")
    await asyncio.sleep(0.3)
    link.close()


def stood(witness: Operator) -> bool:
    """Whether no mode that was heard says that anything was obeyed."""
    modes = [each for each in witness.heard if isinstance(each, Mode)]
    goals = [each for each in witness.heard if isinstance(each, GoalStatus)]
    return bool(modes) and not goals and {each.mode for each in modes} == {ModeKind.READY}


async def witnessed(running: Running, key: Path, name: str = NAME) -> Operator:
    """Somebody who has the key, and hears how the controller is."""
    witness = await Operator(key, 99).dial(named(running, name))
    witness.say(Goal(5, 3, 0, (math.nan,) * 7, Verb.STATUS, 1, 1))
    await until(lambda: any(isinstance(each, GoalStatus) for each in witness.heard), "it answers")
    witness.heard[:] = [each for each in witness.heard if not isinstance(each, GoalStatus)]
    await until(lambda: witness.latest() is not None, "it says how it is")
    return witness


@pytest.mark.parametrize("number", range(6))
async def test_its_key_is_that_of_the_golden_vectors(start: Start, tmp_path: Path, number: int) -> None:
    vector = json.loads(GOLDEN.read_text())[number]
    master = tmp_path / "master.key"
    master.touch(mode=0o600)
    master.write_text(f"# of the cell\ntcp:*  {'7f' * 32}\n* {vector['master']}\n")
    name = vector["controller"]
    if name.startswith("tcp:"):
        master.write_text(f"* {vector['master']}\n")
    with start(name, key=master) as running:
        station = await Station(security=Punctual(bytes.fromhex(vector["key"]))).dial(running.url)
        station.say(Goal(5, 1, 0, (math.nan,) * 7, Verb.STATUS, 1, 1))
        await station.told(GoalStatus, key=5)
        assert station.refused == 0, "it signs with the same key"


async def test_a_line_with_its_very_name_has_its_own_key(start: Start, tmp_path: Path) -> None:
    file = tmp_path / "own.key"
    file.touch(mode=0o600)
    file.write_text(f"{NAME} {'5a' * 32}\n* {'7f' * 32}\n")
    with start(key=file) as running:
        station = await Station(security=Punctual(b"\x5a" * 32)).dial(running.url)
        station.say(Goal(5, 1, 0, (math.nan,) * 7, Verb.STATUS, 1, 1))
        await station.told(GoalStatus, key=5)
        assert station.refused == 0


@pytest.mark.parametrize("security", [None, Punctual(b"o" * 32)], ids=["unsigned", "another key"])
async def test_who_has_not_the_key_commands_nothing(
    start: Start, key: Path, security: Punctual | None
) -> None:
    with start() as running:
        stranger = await (Station(security=security) if security else Station()).dial(running.url)
        for order in ORDERS:
            stranger.say(order)
        await until(lambda: "refused: a frame of 255" in running.complaints(), "it says so")
        await asyncio.sleep(0.3)
        stranger.link.close()
        witness = await witnessed(running, key)
        assert stood(witness)
        assert {each.epoch for each in witness.heard if isinstance(each, Mode)} == {0}


async def test_a_recording_of_one_controller_does_nothing_at_another_one(start: Start, key: Path) -> None:
    with start() as running, start("rover-2") as other:
        operator = await drive(running, key)
        await replay(other, operator.said)
        witness = await witnessed(other, key, "rover-2")
        await asyncio.sleep(0.6)
        assert stood(witness)


async def test_a_recording_is_not_obeyed_again_by_the_same_controller(start: Start, key: Path) -> None:
    with start() as running:
        operator = await drive(running, key)
        operator.say(SetMode(3, 1, 1, ModeKind.SAFE_STOP))
        await until(lambda: operator.latest() == ModeKind.SAFE_STOP, "it is stopped")
        operator._link.close()
        await replay(running, operator.said[:-1])
        witness = await witnessed(running, key)
        assert witness.latest() == ModeKind.SAFE_STOP


@pytest.mark.parametrize("offset", [0, -3600], ids=["at once", "with the clock set back"])
async def test_a_recording_does_nothing_after_a_restart(
    start: Start, key: Path, tmp_path: Path, offset: int
) -> None:
    with start() as running:
        operator = await drive(running, key)
        os.kill(running.process.pid, signal.SIGKILL)
        running.process.wait()
    with start(env=clock(tmp_path, offset) if offset else {}) as again:
        await replay(again, operator.said)
        witness = await witnessed(again, key)
        await asyncio.sleep(0.6)
        assert stood(witness)
        assert {each.epoch for each in witness.heard if isinstance(each, Mode)} == {3}, "it remembers"


def clock(folder: Path, offset: int) -> dict[str, str]:
    """An environment in which the wall clock is wrong by seconds."""
    assert COMPILER is not None
    library, source = folder / "clock.so", folder / "clock.c"
    source.write_text(CLOCK)
    subprocess.run([COMPILER, "-shared", "-fPIC", source, "-o", library, "-ldl"], check=True)
    sanitizers = {"ASAN_OPTIONS": "verify_asan_link_order=0"}
    return {"LD_PRELOAD": str(library), "CLOCK_OFFSET": str(offset), **sanitizers}


async def test_many_programs_one_after_the_other_lock_nobody_out(start: Start, key: Path) -> None:
    with start() as running:
        for number in range(80):
            operator = await Operator(key, number).dial(named(running))
            operator.say(Goal(5, 1, 0, (math.nan,) * 7, Verb.STATUS, 1, 1))
            await until(
                lambda operator=operator: any(isinstance(each, GoalStatus) for each in operator.heard), number
            )
            operator._link.close()
        assert running.complaints().count("refused") == 0


def refused(program: list[str], *words: str | Path) -> str:
    done = subprocess.run([*program, "0", *words], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode != 0
    assert "ready" not in done.stdout
    return done.stderr


def test_it_does_not_start_with_a_key_that_it_cannot_use(
    program: list[str], key: Path, tmp_path: Path
) -> None:
    memory = ("--memory", tmp_path / "memory", "--reset-epoch")
    assert "--memory" in refused(program, "--key", key)
    assert "no line" in refused(program, *memory, "--key", _file(tmp_path, f"can:* {'7f' * 32}\n"))
    assert "no pattern and key" in refused(program, *memory, "--key", _file(tmp_path, "* 7f7f\n"))
    shutil.copy(key, tmp_path / "open.key")
    (tmp_path / "open.key").chmod(0o644)
    assert "chmod 600" in refused(program, *memory, "--key", tmp_path / "open.key")
    assert "No such file" in refused(program, *memory, "--key", tmp_path / "none.key")


def _file(folder: Path, text: str) -> Path:
    path = folder / f"{abs(hash(text))}.key"
    path.touch(mode=0o600)
    path.write_text(text)
    return path


async def test_a_wrong_clock_of_one_sender_locks_out_nobody(start: Start, key: Path) -> None:
    with start() as running:
        wrong = Punctual(key_bytes(key), derives=True)
        wrong.time._clock = partial(lambda: time.time() + 1e7)
        ahead = await Station(security=wrong).dial(named(running))
        ahead.say(SetMode(3, 1, 1, ModeKind.SAFE_STOP))
        await until(lambda: "more than a minute ahead" in running.complaints(), "it says why")
        ahead.link.close()
        assert stood(await witnessed(running, key))


def key_bytes(key: Path) -> bytes:
    return bytes.fromhex(key.read_text().split()[1])


EPOCH = 1000
NANS = (float("nan"),) * 7


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
    station.say(Goal(epoch, epoch, 0, NANS, Verb.HOLD, 1, 1))
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


@pytest.fixture(scope="session")
def station(controller_c: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its program."""
    include = controller_c.parent / "include"
    program = tmp_path_factory.mktemp("station") / "station"
    source = Path(__file__).with_name("station.c")
    words = [
        COMPILER or "cc",
        "-std=c99",
        "-isystem",
        include,
        "-isystem",
        include / "robotree",
        source,
        "-o",
        program,
    ]
    subprocess.run(words, check=True)
    return program


def passphrase(key: Path, arm: Running) -> str:
    words = [*ROBOTREE, "wire", "key", str(key), "--of", arm.url]
    told = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    found = re.search(r"(?m)^passphrase +(\S+)", told)
    assert found
    return found[1]


def test_the_passphrase_of_one_controller_commands_it_and_no_other(station: Path, tmp_path: Path) -> None:
    key = tmp_path / "cell.key"
    subprocess.run([*ROBOTREE, "wire", "key", str(key)], check=True)
    words = [*ROBOTREE, "sim", "arm", "--listen", "tcp:127.0.0.1:0", "--key", str(key)]
    env = {"XDG_STATE_HOME": str(tmp_path)}
    with started(words, env) as one, started(words, env) as other:
        phrase = passphrase(key, one)

        def said(arm: Running) -> str:
            asked = [station, arm.url.rpartition(":")[2], phrase]
            return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()

        assert said(one) == "answered 0"
        assert said(other) == "silence"
