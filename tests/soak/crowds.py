"""A script whose rule could be met in billions of ways: it ends, a stop reaches all, memory is bounded."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from robotree.vr.base.errors import VrError
from tests.soak.stage import Stage, Verb, names
from tests.soak.stops import ALL, false_reports, marks_of, still_moving, stood
from tests.soak.table import Row, Trial

NAME = "crowd"
MOST_MEMORY = 100
"""[MB] that the host may take for it: 64 for facts, 16 while the script is being ended, and its run."""
IDLE = 0.5
"""[s] of processor time that the host may take in the second after that."""
SOURCE = """\
script: crowd
facts: {place: {id: none}}
hears: {look: {}}
begin with:
BEGIN
rules:
  - rule: pairs
    when:
      - look
      - place: {id: $a}
      - place: {id: $b}
      - place: {id: $c}
      - place: {id: $d}
    then:
      - log: $a $b $c $d
"""
ENDS = Row(
    "script",
    "a rule with four conditions over 200 facts: the script ends with a sentence",
    "from the happening until the command line reports it",
    3.0,
)
STOPPED = Row(
    "script",
    "`stop` while such a rule is compared, two robots moving",
    "from the start of the command line until both stand",
    1.5,
)


async def ends(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Report the happening that such a rule waits for."""
    await stage.furnish()
    async with _led(stage) as (running, host):
        began = asyncio.get_running_loop().time()
        await stage.realm_client.call(NAME, "look", {})
        said = await running.end()
        seconds = asyncio.get_running_loop().time() - began
        trial = Trial(ENDS, "rule pairs" in said.complaints and "too many ways" in said.complaints, seconds)
        trial.note = "" if trial.reached else str(said)
        trial.false = await host.excesses()
    return [trial]


async def stopped(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Stop everything while it compares, with a new command line."""
    await stage.furnish()
    async with _led(stage) as (running, host):
        calls = await stage.both_move()
        verb, marks = await stage.verb("stop", "--json"), marks_of(stage)
        await asyncio.sleep(chance.uniform(0.0, 0.3))
        with contextlib.suppress(VrError):  # the stop was quicker
            await stage.realm_client.call(NAME, "look", {})
        said = await verb.end()
        trial = Trial(STOPPED, said.done and names(said) >= ALL, stood(marks) - verb.began)
        trial.note = "" if trial.reached else str(said)
        trial.false = false_reports(said, stage) + await still_moving(stage, calls)
        trial.false += await host.excesses()
        if (await running.end(5.0)).code is None:
            trial.false.append("the script leads on")
    return [trial]


class _Host:
    """The process in which the script runs, as the kernel sees it."""

    def __init__(self, pid: int) -> None:
        self._folder = Path(f"/proc/{pid}")
        (self._folder / "clear_refs").write_text("5")  # from now on VmHWM is the most of this trial
        self._before = self._memory("VmRSS")

    async def excesses(self) -> list[str]:
        """Name what it has taken too much of, and whether it still computes."""
        grown = (self._memory("VmHWM") - self._before) / 1000
        found = [f"the host took {grown:.0f} MB"] if grown > MOST_MEMORY else []
        before = self._spent()
        await asyncio.sleep(1.0)
        spent = self._spent() - before
        return found + ([f"the host still computes: {spent:.2f} s in one second"] if spent > IDLE else [])

    def _memory(self, name: str) -> int:
        """Return a size of the process [kB]."""
        lines = (self._folder / "status").read_text().splitlines()
        return int(next(line for line in lines if line.startswith(name)).split()[1])

    def _spent(self) -> float:
        """Return its processor time [s]."""
        user, system = (self._folder / "stat").read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


@asynccontextmanager
async def _led(stage: Stage) -> AsyncIterator[tuple[Verb, _Host]]:
    """Have the script lead nobody. Yields: the command line that started it, and its host."""
    page = stage.folder.parent.parent / "crowd.yaml"
    page.write_text(SOURCE.replace("BEGIN", "\n".join(f"  - place: {{id: p{n}}}" for n in range(200))))
    await stage.realm_client.create(str(page), NAME)
    try:
        running = await stage.verb("call", f"{NAME}.start", "--within", "30 s")
        async with asyncio.timeout(10.0):
            while (await stage.realm_client.describe(NAME)).attributes["condition"] != "active":  # noqa: ASYNC110 # another process
                await asyncio.sleep(0.05)
        yield running, _Host(stage.pid("host"))
    finally:
        await stage.realm_client.delete(NAME)
