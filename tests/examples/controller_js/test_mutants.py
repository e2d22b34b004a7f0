"""`wire conform` finds what is broken: each mutant of the controller in JavaScript by its rule."""

from __future__ import annotations

import asyncio
from collections import Counter
from contextlib import ExitStack, aclosing, suppress
from itertools import groupby
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


def test_there_is_a_mutant_for_each_rule() -> None:
    assert list(dict.fromkeys(each.rule for each in MUTANTS)) == [*RULES]
    assert Counter((each.rule, each.does) for each in MUTANTS).most_common(1)[0][1] == 1


def made(mutant: Mutant, controller_js: list[str], folder: Path) -> list[str | Path]:
    """Write a mutant; returns how it is started."""
    folder.mkdir()
    for name in ("node_modules", "robotree.js"):
        (folder / name).symlink_to(Path(controller_js[-1]).parent / name)
    mutant.write(node.SOURCE, folder)
    return [controller_js[0], folder / "controller.js", "0"]


async def outcome(mutant: Mutant, url: str) -> str:
    """What its rule says of a mutant."""
    results: list[Result] = []
    with suppress(NotExaminable):  # some cannot be made ready again
        async with aclosing(examine(url, kind="arm", rules=[mutant.rule])) as examined:
            results.append(await anext(examined))
            await anext(examined, None)
    return " ".join(f"{mutant.rule}, {mutant.does}: {each.outcome} {each.detail}" for each in results)


@pytest.mark.parametrize(
    "mutants", [pytest.param([*each], id=rule) for rule, each in groupby(MUTANTS, lambda each: each.rule)]
)
async def test_each_mutant_is_caught_by_its_rule(
    mutants: list[Mutant], controller_js: list[str], tmp_path: Path
) -> None:
    intact = Mutant(mutants[0].rule, "intact", ())
    quick = () if intact.rule in WITH_LONG_SILENCE else (QUICK,)
    tried = [each._replace(changes=(*each.changes, *quick)) for each in (intact, *mutants)]
    with ExitStack() as stack:
        urls = [
            stack.enter_context(started(made(each, controller_js, tmp_path / str(i)))).url
            for i, each in enumerate(tried)
        ]
        kept, *caught = await asyncio.gather(*map(outcome, tried, urls))
    assert f": {Outcome.KEPT}" in kept
    assert [each for each in caught if f": {Outcome.BROKEN}" not in each] == []
