"""`robotree wire conform` at the controllers of the examples and the simulated ones, and at broken ones."""

from __future__ import annotations

import asyncio
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.protocol.errors import LinkError
from robotree.protocol.links.keyring import Keyring, create
from robotree.protocol.links.security import Security
from robotree.protocol.messages import Claim, ClaimWish
from robotree.protocol.tools.conform import KINDS, RULES, Level, Outcome, Result, examine
from robotree.protocol.tools.conform.examine import NotExaminable
from robotree.sim.serving.server import serving
from robotree.tui import exit_codes
from tests.command_line import ROBOTREE
from tests.examples.controllers import started
from tests.station import Station

pytestmark = pytest.mark.e2e
ROOT = Path(__file__).parents[2]
GUIDE = ROOT / "docs" / "bring-your-own-robot.md"
COMPANION = {"base": 1, "limb": 25, "head": 27}


async def tried(url: str, **options: object) -> list[Result]:
    return [result async for result in examine(url, **options)]  # type: ignore[arg-type]


def broken(results: list[Result], level: Level = Level.MUST) -> dict[str, str]:
    return {
        each.rule.id: each.detail
        for each in results
        if each.outcome is Outcome.BROKEN and each.rule.level is level
    }


def test_the_guide_has_each_rule_with_its_id_and_its_level() -> None:
    levels = tuple(f"| {level} |" for level in Level)
    lines = GUIDE.read_text().splitlines()
    rows = [line for line in lines if line.startswith("| `") and any(level in line for level in levels)]
    assert rows == [f"| `{rule.id}` | {rule.level} | {rule.text} |" for rule in RULES.values()]


async def test_simulated_python_and_javascript_controllers_keep_the_rules(
    controller_py: list[str], controller_js: list[str]
) -> None:
    """The one in C has its own test. All at the same time: most rules wait."""
    with started([*controller_py, "0"]) as in_python, started([*controller_js, "0"]) as in_javascript:
        async with serving("rover", "tcp:127.0.0.1:0") as server:
            simulated, python, javascript = await asyncio.gather(
                *map(tried, (server.address, in_python.url, in_javascript.url))
            )
    assert [each.rule.id for each in simulated] == [*RULES]
    for results in (simulated, javascript):
        assert {each.rule.id: each.detail for each in results if each.outcome is not Outcome.KEPT} == {}
    assert broken(python) == {}
    assert set(broken(python, Level.SHOULD)) == {"life", "several-clients", "sentence"}


@pytest.mark.parametrize("kind", sorted(KINDS.keys() - {"rover"}))
async def test_each_simulated_kind_is_moved_and_holds_as_the_rules_say(kind: str) -> None:
    rules = ("reaches", "cancel", "hold", "time-to-live", "stop")
    async with serving("companion" if kind in COMPANION else kind, "tcp:127.0.0.1:0") as server:
        results = await tried(server.address, kind=kind, controller=(1, COMPANION.get(kind, 1)), rules=rules)
    assert {each.rule.id: each.detail for each in results if each.outcome is not Outcome.KEPT} == {}


@pytest.mark.soak
@pytest.mark.timeout(400)
@pytest.mark.parametrize("kind", sorted(KINDS.keys() - {"rover"}))
async def test_each_simulated_kind_keeps_all_rules(kind: str) -> None:
    async with serving("companion" if kind in COMPANION else kind, "tcp:127.0.0.1:0") as server:
        results = await tried(server.address, kind=kind, controller=(1, COMPANION.get(kind, 1)))
    assert {each.rule.id: each.detail for each in results if each.outcome is not Outcome.KEPT} == {}


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
    words = [*ROBOTREE, "wire", "conform", "--connect", keyed]

    async def conform(*options: str) -> tuple[int, str]:
        done = await asyncio.to_thread(
            subprocess.run, [*words, *options, *rules], capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout + done.stderr

    code, said = await conform("--key", str(tmp_path / "cell.key"))
    assert code == exit_codes.DONE, said
    assert "it conforms.  MUST: 6 kept" in said or "it conforms.  MUST: 5 kept, 0 broken, 1 not" in said, said
    create(tmp_path / "other.key")
    for code, said in await asyncio.gather(conform("--key", str(tmp_path / "other.key")), conform()):
        assert code != exit_codes.DONE, said


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
            await tried(server.address)


async def test_nobody_there_is_told_in_one_sentence() -> None:
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
