"""A realm that changes while a plan is carried out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from robotree.tui.realm_file.applying import bring_about
from robotree.tui.realm_file.content import ProcessEntry
from robotree.tui.realm_file.pages import pages_of
from robotree.tui.realm_file.plan import Plan
from robotree.tui.realm_file.present import Controller
from robotree.tui.realm_file.reading import read_file

if TYPE_CHECKING:
    from tui.conftest import Realm

PAGE = '''
"""Two who stand above each other."""
from robotree.vr import Child, VirtualRobot


class Walker(VirtualRobot):
    """Stands below."""


class Leader(VirtualRobot):
    """Stands above."""

    walker = Child("Walker", "walks", optional=True)
'''
WANTED = """
robots:
  first: {page: "team.py:Leader"}
  second: {page: "team.py:Leader", slots: {walker: walks}}
  walks: {page: "team.py:Walker"}
"""


class Nobody:
    """Starts nothing: all processes are there."""

    controllers: ClassVar[Mapping[str, Controller]] = {}

    async def start(self, entry: ProcessEntry, words: Sequence[str], environment: Mapping[str, str]) -> str:
        raise AssertionError((entry, words, environment))


async def test_a_slot_that_was_emptied_meanwhile_is_released_already(realm: Realm, tmp_path: Path) -> None:
    page = tmp_path / "team.py"
    page.write_text(PAGE)
    (tmp_path / "cell.yaml").write_text(WANTED)
    client = realm.realm_client
    for name, kind in (("first", "Leader"), ("second", "Leader"), ("walks", "Walker")):
        await client.create(str(page), name, wanted=kind)
    await client.enslave("first", "walker", "walks")
    wanted = read_file(WANTED, str(tmp_path / "cell.yaml"))
    planned: list[str] = []

    async def agree(found: Plan) -> None:
        planned.extend(step.text for step in found.steps)
        await client.release("first", "walker")  # as another person does, or a lease that ends

    _, done = await bring_about(wanted, pages_of(wanted), client, Nobody(), lambda _: None, agree)
    assert planned == ["release first.walker", "enslave second.walker walks"]
    assert [(one.outcome, one.reason) for one in done] == [("done", ""), ("done", "")]
    assert (await client.describe("walks")).bond is not None
