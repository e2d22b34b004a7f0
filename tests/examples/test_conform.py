"""`robotree wire conform` at the controllers of the examples and the simulated ones, and at broken ones."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from robotree.protocol.errors import LinkError
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.security import UNSIGNED, Security
from robotree.protocol.messages import Claim, ClaimWish, GoalState, GoalStatus, Mode, Reason
from robotree.protocol.tools.conform import KINDS, RULES, Level, Outcome, Result
from robotree.protocol.tools.conform.examine import NotExaminable
from robotree.protocol.tools.conform.trial import BEAT, FIRST, Spoken, Trial
from robotree.sim.serving.server import serving
from robotree.tui import exit_codes
from tests.command_line import ROBOTREE
from tests.examples.controllers import AT_ONCE, not_kept, started, tried, tried_alike, tried_at
from tests.station import Station

pytestmark = pytest.mark.e2e
ROOT = Path(__file__).parents[2]
COMPANION = {"base": 1, "limb": 25, "head": 27}


def broken(results: list[Result], level: Level = Level.MUST) -> dict[str, str]:
    return {
        each.rule.id: each.detail
        for each in results
        if each.outcome is Outcome.BROKEN and each.rule.level is level
    }


async def test_the_controller_in_c_keeps_all_rules(controller_c: Path) -> None:
    assert not_kept(await tried_alike([str(controller_c), "0"], kind="rover")) == {}


async def test_the_controller_in_javascript_keeps_all_rules(controller_js: list[str]) -> None:
    assert not_kept(await tried_alike([*controller_js, "0"], kind="arm")) == {}


@pytest.mark.parametrize("start", [0xFE, 0xFD])
async def test_noise_that_looks_like_the_start_of_a_long_frame_swallows_no_question(
    start: int, controller_js: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    key = int.from_bytes(bytes((start, 0xFF)) * 4, "little")
    monkeypatch.setattr(Trial, "key", lambda _: key)
    with started([*controller_js, "0"]) as running:
        assert not_kept(await tried(running.url, kind="arm", rules=["noise"])) == {}


async def test_the_end_of_a_goal_that_comes_with_its_beginning_is_heard_after_a_heartbeat() -> None:
    async with serving("rover", "tcp:127.0.0.1:0") as server:
        trial = Trial(server.address, motions=KINDS["rover"])
        await trial.start()
        await trial.line.expect(Mode)
        for state in (
            GoalState.ACTIVE,
            GoalState.SUCCEEDED,
        ):  # both arrive while this process waits for a core
            status = GoalStatus(1, 1, 1.0, 1, Reason.NONE, *FIRST, state)
            trial.line.received.append(Spoken(trial.now(), sent=False, system=1, component=1, message=status))
        first = await trial.line.expect(GoalStatus)
        trial.line.say(BEAT)
        second = await trial.line.expect(GoalStatus, within=0.1)
        trial.close()
    assert (first.state, second.state) == (GoalState.ACTIVE, GoalState.SUCCEEDED)


async def test_the_controller_in_python_keeps_all_rules_that_it_must(controller_py: list[str]) -> None:
    results = await tried_alike([*controller_py, "0"], kind="rover")
    assert broken(results) == {}
    assert set(broken(results, Level.SHOULD)) == {"life", "several-clients", "sentence"}


async def test_the_simulated_controller_keeps_all_rules() -> None:
    async with AsyncExitStack() as stack:
        serves = [serving("rover", "tcp:127.0.0.1:0") for _ in range(AT_ONCE)]
        urls = [(await stack.enter_async_context(each)).address for each in serves]
        results = await tried_at(urls)
    assert [each.rule.id for each in results] == [*RULES]
    assert not_kept(results) == {}


async def test_each_simulated_kind_is_moved_and_holds_as_the_rules_say() -> None:
    """The parts of the companion are tried at the same time: each has goals, stops and claims of its own."""
    assert {"arm", *COMPANION} == KINDS.keys() - {"rover"}
    rules = ("reaches", "cancel", "hold", "time-to-live", "stop")
    async with serving("arm", "tcp:127.0.0.1:0") as server:
        assert not_kept(await tried(server.address, kind="arm", rules=rules)) == {}
    async with serving("companion", "tcp:127.0.0.1:0") as server:
        tries = [
            tried(server.address, kind=kind, controller=(1, component), rules=rules)
            for kind, component in COMPANION.items()
        ]
        results = await asyncio.gather(*tries)
    assert dict(zip(COMPANION, map(not_kept, results), strict=True)) == {kind: {} for kind in COMPANION}


@pytest.mark.soak
@pytest.mark.timeout(400)
@pytest.mark.parametrize("kind", sorted(KINDS.keys() - {"rover"}))
async def test_each_simulated_kind_keeps_all_rules(kind: str) -> None:
    async with serving("companion" if kind in COMPANION else kind, "tcp:127.0.0.1:0") as server:
        results = await tried(server.address, kind=kind, controller=(1, COMPANION.get(kind, 1)))
    assert not_kept(results) == {}


@pytest.fixture(params=["sim", "c", "python"])
def keyed(
    request: pytest.FixtureRequest, controller_c: Path, controller_py: list[str], tmp_path: Path
) -> Iterator[str]:
    """The address of a controller with a key, as of another place: it needs a name there."""
    key = tmp_path / "cell.key"
    create(key)
    if request.param == "sim":
        words = [
            *ROBOTREE,
            "sim",
            "rover",
            "--listen",
            "tcp:127.0.0.1:0?controller=rover-1",
            "--key",
            str(key),
        ]
    else:
        program = [str(controller_c)] if request.param == "c" else controller_py
        memory = ("--memory", str(tmp_path / "memory"), "--reset-epoch")
        words = [*program, "0", *memory, "--key", str(key), "--name", "rover-1"]
    with started(words, {"XDG_STATE_HOME": str(tmp_path / "state")}) as running:
        yield f"{running.url.partition('?')[0]}?controller=rover-1"


async def test_a_controller_with_a_key_is_examined_by_who_has_the_key_and_by_nobody_else(
    keyed: str, tmp_path: Path
) -> None:
    rules = ("introduction", "reaches", "stop", "key-of-sender", "link-other", "epoch-told")
    words = [*ROBOTREE, "wire", "conform", "--connect", keyed, "--kind", "rover"]
    words += ["--key", str(tmp_path / "cell.key"), *rules]
    done = await asyncio.to_thread(subprocess.run, words, capture_output=True, text=True, check=False)
    assert done.returncode == exit_codes.DONE, done.stdout + done.stderr
    assert re.search("it conforms.  MUST: (6 kept|5 kept, 0 broken, 1 not)", done.stdout), done.stdout
    create(tmp_path / "other.key")
    another = Security(Keyring(tmp_path / "other.key"), time.time)
    others = (tried(keyed, kind="rover", rules=rules[1:2], security=each) for each in (another, UNSIGNED))
    for found in await asyncio.gather(*others, return_exceptions=True):
        assert isinstance(found, NotExaminable) or not_kept(found), "nobody else moves it"


@pytest.mark.soak
@pytest.mark.timeout(400)
async def test_with_a_key_a_controller_keeps_all_rules_that_it_must(keyed: str, tmp_path: Path) -> None:
    security = Security(Keyring(tmp_path / "cell.key"), time.time)
    results = await tried(keyed, security=security)
    assert broken(results) == {}
    assert set(broken(results, Level.SHOULD)) <= {"life", "several-clients", "sentence"}


async def test_a_controller_that_somebody_commands_is_left_alone() -> None:
    async with serving("rover", "tcp:127.0.0.1:0") as server:
        proxy = await Station(component=30).dial(server.address)
        proxy.say(Claim(5, 9, 30_000, 0, 1, 1, ClaimWish.KEEP, "rover-1, pid 812"))
        await proxy.ping()
        with pytest.raises(NotExaminable, match="rover-1, pid 812 holds this controller; end it first"):
            await tried(server.address, kind="rover")


async def test_nobody_there_is_told_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[NotExaminable.__module__], "OBSERVED", 0.3)
    with pytest.raises(LinkError, match=r"tcp:127\.0\.0\.1:1 cannot be opened"):
        await tried("tcp:127.0.0.1:1")

    ended = asyncio.Event()

    async def ignore(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read()
        writer.close()
        await writer.wait_closed()
        ended.set()

    silent = await asyncio.start_server(ignore, "127.0.0.1", 0)
    port = silent.sockets[0].getsockname()[1]
    with pytest.raises(
        NotExaminable, match=r"HEARTBEAT did not come within .*; is a controller of robotree's"
    ):
        await tried(f"tcp:127.0.0.1:{port}")
    await ended.wait()
    silent.close()
