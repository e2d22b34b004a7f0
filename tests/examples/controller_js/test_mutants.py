"""`wire conform` finds what is broken: each mutant of the controller in JavaScript by its rule."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, aclosing, suppress
from pathlib import Path

import pytest

from robotree.protocol.tools.conform import RULES, Outcome, Result, examine
from robotree.protocol.tools.conform.examine import NotExaminable
from tests.examples.controller_js.mutants import MUTANTS, QUICK, UNHEARD, Mutant
from tests.examples.controllers import JAVASCRIPT, started

pytestmark = pytest.mark.e2e

WITH_LONG_SILENCE = {"claim-term", "silence"}
"""Rules about a time that must end before the silence does, or about the silence itself."""
SEVERAL = Path(__file__).with_name("several.js")
AT_ONCE = 5
"""Rules that are tried at the same time: most only wait, and a controller takes 3 % of a core."""
TOGETHER = 3
"""Rules whose mutants one process runs: it takes longer to start than they do."""


def intact(rule: str) -> Mutant:
    """Return the controller as it is, for a rule."""
    return Mutant(rule, "intact", ())


def test_there_is_a_mutant_for_each_rule() -> None:
    assert list(dict.fromkeys(each.rule for each in MUTANTS)) == [*RULES]
    assert Counter((each.rule, each.does) for each in MUTANTS).most_common(1)[0][1] == 1


def written(mutant: Mutant, controller_js: list[str], folder: Path) -> Path:
    """Write a mutant into a folder that is made."""
    folder.mkdir()
    for name in ("node_modules", "robotree.js"):
        (folder / name).symlink_to(Path(controller_js[-1]).parent / name)
    quick = () if mutant.rule in WITH_LONG_SILENCE else (QUICK,)
    mutant._replace(changes=(*mutant.changes, *quick, UNHEARD)).write(JAVASCRIPT, folder)
    return folder


async def outcome(mutant: Mutant, url: str) -> str:
    """What its rule says of a mutant."""
    results: list[Result] = []
    with suppress(NotExaminable):  # some cannot be made ready again
        async with aclosing(examine(url, kind="arm", rules=[mutant.rule])) as examined:
            results.append(await anext(examined))
            await anext(examined, None)
    return " ".join(f"{mutant.rule}, {mutant.does}: {each.outcome} {each.detail}" for each in results)


async def outcomes(rules: Sequence[str], controller_js: list[str], folder: Path) -> dict[Mutant, str]:
    """What each rule says of its mutants at the same time, rule after rule; one process runs them all."""
    mutants = [
        each for rule in rules for each in (intact(rule), *(one for one in MUTANTS if one.rule == rule))
    ]
    folders = [written(each, controller_js, folder / str(i)) for i, each in enumerate(mutants)]
    found = dict[Mutant, str]()
    with ExitStack() as stack:
        running = started([controller_js[0], SEVERAL, *folders])
        first = await asyncio.to_thread(stack.enter_context, running)
        assert first.process.stdout is not None
        lines = await asyncio.to_thread(
            lambda told: [told.readline() for _ in folders[1:]], first.process.stdout
        )
        urls = dict(zip(mutants, [first.url, *(line.split()[1] for line in lines)], strict=True))
        for rule in rules:
            tried = [each for each in mutants if each.rule == rule]
            told = await asyncio.gather(*(outcome(each, urls[each]) for each in tried))
            found.update(zip(tried, told, strict=True))
    return found


@pytest.fixture(scope="module")
def tried(
    request: pytest.FixtureRequest, controller_js: list[str], tmp_path_factory: pytest.TempPathFactory
) -> dict[Mutant, str]:
    """What its rule says of each mutant that the chosen tests are about, and of the intact controller."""
    tests = [item for item in request.session.items if item.path == request.path]
    chosen = [test.callspec.params["rule"] for test in tests if hasattr(test, "callspec")]

    shares = iter([chosen[first : first + TOGETHER] for first in range(0, len(chosen), TOGETHER)])
    found = dict[Mutant, str]()

    async def try_all() -> None:
        async with asyncio.TaskGroup() as tasks:
            for _ in range(AT_ONCE):
                tasks.create_task(try_shares())

    async def try_shares() -> None:
        for share in shares:
            found.update(await outcomes(share, controller_js, tmp_path_factory.mktemp("mutants")))

    asyncio.run(try_all())
    return found


@pytest.mark.parametrize("rule", RULES)
def test_each_mutant_is_caught_by_its_rule(rule: str, tried: dict[Mutant, str]) -> None:
    assert f": {Outcome.KEPT}" in tried[intact(rule)]
    caught = [tried[each] for each in MUTANTS if each.rule == rule]
    assert [each for each in caught if f": {Outcome.BROKEN}" not in each] == []
