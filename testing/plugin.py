"""For pytest, which loads it by its entry point: readable differences, rehearsals that end, a living realm.

It loads nothing of the kit before a test does.
"""

from __future__ import annotations

import sys
from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import pytest

from robotree.testing import chosen

if TYPE_CHECKING:
    from robotree.client.blocking import Realm
    from robotree.testing.team import Team

SEED = "--robotree-seed"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Take the seed that a test under many seeds is to play again."""
    group = parser.getgroup("robotree", "rehearsals of virtual robots")
    group.addoption(
        SEED, type=int, default=None, metavar="N", help="play only this seed in rehearse_seeds(...)"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Pass the seed of the command line on."""
    chosen.seed = config.getoption(SEED)


@pytest.fixture
def robotree_realm() -> Generator[Realm]:
    """Give a test the realm whose robots run: that of `$ROBOTREE_REALM`, else `default`."""
    from robotree import connect

    with connect() as realm:
        yield realm


def pytest_assertrepr_compare(op: str, left: object, right: object) -> list[str] | None:
    """Show where two lists of what was commanded differ."""
    kit = sys.modules.get("robotree.testing.journal")
    if kit is None or op != "==":
        return None
    if isinstance(left, kit.Commanded) and isinstance(right, list | tuple | kit.Commanded):
        return _difference(kit, left, right)
    if isinstance(right, kit.Commanded) and isinstance(left, list | tuple):
        return _difference(kit, right, left)
    return None


def _difference(kit: Any, commanded: Any, expected: Any) -> list[str]:
    return [
        "what was commanded is not what the test expects (- expected, + commanded)",
        *kit.difference(commanded, expected),
    ]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Show the story of each rehearsal of a test that failed."""
    report = yield
    if report.when == "call" and report.failed:
        for number, team in enumerate(_unended(item), 1):
            report.sections.append((f"rehearsal {number}: what was commanded", team.story()))
    return report


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    """End the rehearsals that the test has left open."""
    for team in _unended(item):
        team.close()


def _unended(_: pytest.Item) -> list[Team]:
    kit = sys.modules.get("robotree.testing.team")
    return [] if kit is None else kit.unended()
