"""A demo is in the realm that other verbs of the same shell would see."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from robotree.tui import demo
from robotree.tui.errors import MemberFailed
from robotree.tui.exit_codes import REFUSED
from robotree.tui.wire.security import REALM_KEY
from robotree.vr.network.realms import realm_folder

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.tui.processes.crew import Crew


class Unlucky:
    """A demo whose first program does not start."""

    file = demo.CELL.file
    goals = None

    def __init__(self) -> None:
        self.realm = self.key = ""

    async def cast(self, crew: Crew, **_options: object) -> None:
        self.realm, self.key = crew.realm, crew._environment["ROBOTREE_KEY"]  # of its members
        raise MemberFailed(["sim"], "did not start", "")

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:
        del realm, folder, readonly
        raise AssertionError


@pytest.mark.parametrize(("given", "wanted"), [("", "mine"), ("other", "other")])
async def test_a_demo_for_a_person_is_in_the_realm_of_the_environment(
    monkeypatch: pytest.MonkeyPatch, given: str, wanted: str
) -> None:
    monkeypatch.setenv("ROBOTREE_REALM", "mine")
    story = Unlucky()
    monkeypatch.setattr(demo, "cast", story.cast)
    assert await demo.demo(story, headless=False, realm=given, key="none") == REFUSED
    assert (story.realm, story.key) == (wanted, "none")


async def test_a_demo_of_a_script_leaves_neither_its_realm_nor_its_key(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    story, own = Unlucky(), realm_folder(demo.own_realm(headless=True))

    async def cast(crew: Crew, **options: object) -> None:
        assert (own / REALM_KEY).exists()
        await story.cast(crew, **options)

    monkeypatch.setattr(demo, "cast", cast)
    assert await demo.demo(story, headless=True, pictures=str(tmp_path)) == REFUSED
    assert (story.realm, story.key) == (own.name, str(own / REALM_KEY))
    assert not own.exists()
