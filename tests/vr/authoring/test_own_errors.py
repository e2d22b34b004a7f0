"""Error classes of pages: they arrive as themselves where the page is known, else with their name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from robotree.kinds import Arm
from robotree.testing import Fake, Page, rehearse
from robotree.testing.team import Team
from robotree.vr import Child, CommandFailed, Failed, VirtualRobot, command
from robotree.vr.base.errors import CommandCancelled, VrError
from robotree.vr.base.own_class import OwnClass
from robotree.vr.base.requests import Raised, decode_reply, encode
from robotree.vr.running.own_errors import as_itself, own_class_of

ERRORS = '''"""What can go wrong at a shelf."""

from robotree.vr import Failed


class ShelfEmpty(Exception):
    """A plain class, whose constructor takes something else than it hands on."""

    def __init__(self, shelf):
        super().__init__(f"nothing on {shelf}")
        self.shelf = shelf


class TooHeavy(Failed):
    """A kind of failure."""
'''
SHELF = '''"""A shelf."""

from errors import ShelfEmpty, TooHeavy

from robotree.vr import VirtualRobot, command


class Shelf(VirtualRobot):
    """Fails in two ways."""

    @command
    def fetch(self, how: str) -> None:
        """Fail."""
        raise ShelfEmpty(3) if how == "plain" else TooHeavy("it is too heavy", mass=2.5)
'''
FETCHER = '''"""A page that knows the classes of its child."""

{imports}

from robotree.vr import Child, CommandFailed, VirtualRobot, command


class Fetcher(VirtualRobot):
    """Fetches."""

    shelf = Child("Shelf")

    @command
    def fetch(self, how: str) -> str:
        """Say how it failed."""
        try:
            self.shelf.fetch(how=how)
        except {plain} as error:
            return f"ShelfEmpty {{error}}, {{error.shelf + 1}}, {{error.__cause__}}"
        except {failed} as error:
            return f"TooHeavy {{error.detail}}, {{error.mass + 1}}, {{error}}"
        except CommandFailed as error:
            return f"{{type(error).__name__}} {{error}}"

    @command
    def pass_up(self) -> None:
        """Let it go up."""
        self.shelf.fetch(how="plain")
'''


@pytest.fixture
def pages(tmp_path: Path) -> Path:
    """Return a folder with a page for the child, and its errors beside it."""
    (tmp_path / "errors.py").write_text(ERRORS)
    (tmp_path / "shelf.py").write_text(SHELF)
    return tmp_path


def fetcher(pages: Path, imports: str, plain: str = "ShelfEmpty", failed: str = "TooHeavy") -> Team:
    """Rehearse a page that imports the classes in some way."""
    page = pages / "fetcher.py"
    page.write_text(FETCHER.format(imports=imports, plain=plain, failed=failed))
    return rehearse(page, shelf=Page(pages / "shelf.py"))


@pytest.mark.parametrize(
    ("imports", "plain", "failed"),
    [
        ("from errors import ShelfEmpty, TooHeavy", "ShelfEmpty", "TooHeavy"),
        ("from errors import ShelfEmpty as Gone, TooHeavy as Heavy", "Gone", "Heavy"),
        ("import errors", "errors.ShelfEmpty", "errors.TooHeavy"),
    ],
)
def test_a_class_that_both_pages_import_arrives_as_itself(
    pages: Path, imports: str, plain: str, failed: str
) -> None:
    team = fetcher(pages, imports, plain, failed)
    told = team.call("fetch", how="plain")
    assert told.startswith("ShelfEmpty nothing on 3, 4, ")
    assert "failed: ShelfEmpty: nothing on 3 (shelf.py, line " in told
    told = team.call("fetch", how="failed")
    assert told.startswith("TooHeavy it is too heavy, 3.5, ")
    assert told.endswith(".fetch failed: it is too heavy (mass=2.5)")


def test_a_class_of_the_same_name_from_another_source_is_another_class(pages: Path) -> None:
    (pages / "mine.py").write_text(ERRORS + "# changed\n")
    team = fetcher(pages, "from mine import ShelfEmpty, TooHeavy")
    told = team.call("fetch", how="plain")
    assert told.startswith("CommandFailed ")
    assert "ShelfEmpty: nothing on 3" in told
    told = team.call("fetch", how="failed")
    assert told.startswith("Failed ")
    assert told.endswith("it is too heavy (mass=2.5) (TooHeavy)")


def test_it_goes_up_through_a_page_that_does_not_know_it(pages: Path) -> None:
    team = fetcher(pages, "ShelfEmpty = TooHeavy = KeyError")
    with pytest.raises(CommandFailed, match=r"ShelfEmpty: nothing on 3 \(shelf\.py, line") as caught:
        team.call("pass_up")
    own = caught.value.own_class
    assert own is not None
    assert (own.name, own.values) == ("ShelfEmpty", {"shelf": 3})


class NothingThere(Exception):
    """A class of a page that is given to the test kit as a class."""


class Reacher(VirtualRobot):
    """Reaches for something."""

    arm = Child("Arm")

    @command
    def reach(self) -> str:
        """Say how it failed."""
        try:
            self.arm.grip(action="close")
        except NothingThere as error:
            return f"NothingThere {error}"
        return "done"

    @command
    def reach_twice(self) -> str:
        """Fail in a block."""
        try:
            with self.together() as both:
                both.start(self.arm.grip, action="close")
        except NothingThere as error:
            return f"NothingThere {error}"
        return "done"


def test_a_fake_raises_a_class_of_the_page() -> None:
    team = rehearse(Reacher, arm=Fake(Arm, grip=NothingThere("at all")))
    assert team.call("reach") == "NothingThere at all"
    assert team.call("reach_twice") == "NothingThere at all"
    team = rehearse(Reacher, arm=Fake(Arm).refuse("grip", error=NothingThere("once")))
    assert team.call("reach") == "NothingThere once"
    assert team.call("reach") == "done"


# -- what comes from afar is only looked up ---------------------------------------------------------


def arrived(base: VrError, **own: Any) -> VrError:
    """Return an error as it comes over the wire, with the description of a class."""
    known = own_class_of(NothingThere("x"))
    assert known is not None
    fields = {"name": known.name, "digest": known.digest, "arguments": ("x",)} | own
    base.own_class = OwnClass(**fields)
    reply = decode_reply(encode(Raised.of(base)), key="arm-1")
    assert isinstance(reply, Raised)
    return reply.revive()


def failed() -> CommandFailed:
    return CommandFailed(robot="arm-1", command="grip", detail="NothingThere: x")


def test_what_arrives_is_looked_up_with_name_digest_and_base() -> None:
    assert type(as_itself(Reacher, arrived(failed()))) is NothingThere
    cancelled = CommandCancelled(robot="arm-1", command="grip", reason="somebody")
    for error in (
        arrived(failed(), digest="0" * 64),
        arrived(failed(), digest=""),
        arrived(failed(), name="SystemExit"),
        arrived(failed(), name="CommandFailed"),
        arrived(failed(), name="JSONDecodeError"),
        arrived(failed(), name="Reacher"),
        arrived(cancelled),
    ):
        assert as_itself(Reacher, error) is error


def test_only_classes_of_pages_are_described() -> None:
    assert own_class_of(json.JSONDecodeError("x", "y", 0)) is None
    assert own_class_of(Failed("x")) is None
    assert own_class_of(ValueError("x")) is None
    assert own_class_of(pytest.UsageError("x")) is None


def test_what_cannot_travel_arrives_as_text() -> None:
    own = own_class_of(NothingThere(object(), {1: 2}))
    assert own is not None
    assert all(isinstance(each, str) for each in own.arguments)
    encode(Raised.of(failed()))
