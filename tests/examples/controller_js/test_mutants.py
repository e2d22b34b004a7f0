"""`wire conform` finds what is broken: each mutant of the controller in JavaScript by its rule."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, aclosing, suppress
from pathlib import Path

import pytest

from robotree.protocol.tools.conform import RULES, Outcome, Result, examine
from robotree.protocol.tools.conform.examine import NotExaminable
from tests.examples import node
from tests.examples.controller_js.mutants import MUTANTS, QUICK, Mutant
from tests.examples.controllers import started

pytestmark = pytest.mark.e2e

WITH_LONG_SILENCE = {"claim-term"}
"""Rules about a time that must end before the silence does."""
SEVERAL = Path(__file__).with_name("several.js")
AT_ONCE = 5
"""Rules that are tried at the same time: most only wait, and a controller takes 3 % of a core."""


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
    mutant._replace(changes=(*mutant.changes, *quick)).write(node.SOURCE, folder)
    return folder


async def outcome(mutant: Mutant, url: str) -> str:
    """What its rule says of a mutant."""
    results: list[Result] = []
    with suppress(NotExaminable):  # some cannot be made ready again
        async with aclosing(examine(url, kind="arm", rules=[mutant.rule])) as examined:
            results.append(await anext(examined))
            await anext(examined, None)
    return " ".join(f"{mutant.rule}, {mutant.does}: {each.outcome} {each.detail}" for each in results)


async def outcomes(mutants: Sequence[Mutant], controller_js: list[str], folder: Path) -> list[str]:
    """What their rule says of mutants, which one process runs, at the same time."""
    folders = [written(each, controller_js, folder / str(i)) for i, each in enumerate(mutants)]
    with ExitStack() as stack:
        running = started([controller_js[0], SEVERAL, *folders])
        first = await asyncio.to_thread(stack.enter_context, running)
        assert first.process.stdout is not None
        lines = [first.process.stdout.readline() for _ in folders[1:]]
        urls = [first.url, *(line.split()[1] for line in lines)]
        return await asyncio.gather(*map(outcome, mutants, urls))


@pytest.fixture(scope="module")
def tried(
    request: pytest.FixtureRequest, controller_js: list[str], tmp_path_factory: pytest.TempPathFactory
) -> dict[Mutant, str]:
    """What its rule says of each mutant that the chosen tests are about, and of the intact controller."""
    tests = [item for item in request.session.items if item.path == request.path]
    chosen = [test.callspec.params["rule"] for test in tests if hasattr(test, "callspec")]
    found = dict[Mutant, str]()

    async def try_all() -> None:
        rules = iter(chosen)
        async with asyncio.TaskGroup() as tasks:
            for _ in range(AT_ONCE):
                tasks.create_task(try_each(rules))

    async def try_each(rules: Iterator[str]) -> None:
        for rule in rules:
            mutants = [intact(rule), *(each for each in MUTANTS if each.rule == rule)]
            folder = tmp_path_factory.mktemp(rule)
            found.update(zip(mutants, await outcomes(mutants, controller_js, folder), strict=True))

    asyncio.run(try_all())
    return found


@pytest.mark.parametrize("rule", RULES)
def test_each_mutant_is_caught_by_its_rule(rule: str, tried: dict[Mutant, str]) -> None:
    assert f": {Outcome.KEPT}" in tried[intact(rule)]
    caught = [tried[each] for each in MUTANTS if each.rule == rule]
    assert [each for each in caught if f": {Outcome.BROKEN}" not in each] == []
