"""Errors that a page raises, and methods that are called again when they have failed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from robotree.kinds import Arm
from robotree.testing import Fake, Page, in_turn, rehearse
from robotree.testing.team import Team
from robotree.vr import (
    BadArgument,
    Child,
    ChildCancelled,
    ChildTimeout,
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    Failed,
    SlotEmpty,
    VirtualRobot,
    VrError,
    command,
    retry,
)
from robotree.vr.base.errors import Busy, NoAnswer, Stopped
from robotree.vr.base.own_class import OwnClass
from robotree.vr.base.requests import Raised, decode_reply, encode
from robotree.vr.running.own_errors import as_itself, own_class_of

# -- error classes of pages: they arrive as themselves where the page is known, else with their name


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


# -- `@retry`: what has surely failed is tried again, with new keys; an end or a doubt never is ----


class Slipped(Exception):
    """A class of the page's own."""


class Stubborn(VirtualRobot):
    """Tries again."""

    arm = Child("Arm")

    @retry(times=3, backoff="1 s")
    def close(self) -> None:
        """Close the gripper."""
        self.arm.grip(action="close")

    @command
    def grip(self) -> None:
        """Close the gripper."""
        self.close()

    @command
    @retry(times=2)
    def go(self, limit: float) -> None:
        """Go within a limit."""
        self.arm.go_to(x=0.3, y=0, z=0.3, twist=0, within=limit)

    @command
    @retry(times=5)
    def disguise(self) -> None:
        """Raise an error of its own."""
        try:
            self.arm.grip(action="close")
        except VrError as error:
            raise Slipped("it slipped") from error

    @command
    @retry(times=5)
    def mistake(self) -> None:
        """Make a mistake after a call."""
        self.arm.grip(action="close")
        raise ValueError("a mistake")


def stubborn(*results: object) -> Team:
    return rehearse(Stubborn, arm=Fake(Arm, takes=0.1, grip=in_turn(*results)))


def attempts(team: Team) -> int:
    return len(team.commanded)


def test_each_repetition_is_a_new_call_with_a_new_key() -> None:
    team = stubborn(Failed("slipped"), Slipped("again"), None)
    team.call("grip")
    calls = [step for step in team.steps if step.command == "grip" and step.robot]
    assert len({step.key for step in calls}) == attempts(team) == 3
    first, second, third = (step.at for step in calls)
    assert second - first == pytest.approx(1.1, abs=0.05)
    assert third - second == pytest.approx(2.1, abs=0.05)


def test_the_last_failure_is_raised() -> None:
    team = stubborn(Failed("one"), Failed("two"), Failed("three"), None)
    with pytest.raises(Failed, match="three"):
        team.call("grip")
    assert attempts(team) == 3


def test_a_robot_whose_queue_is_full_is_asked_again() -> None:
    team = stubborn(Busy(robot="arm", waiting=9, how="wait"), None)
    team.call("grip")
    assert attempts(team) == 2


@pytest.mark.parametrize(
    "error",
    [
        CommandInDoubt("it may hold it"),
        DeadlineExceeded(),
        CommandCancelled("somebody"),
        Stopped(robot="arm", reason="x", commander="arm"),
        BadArgument("action", "is none"),
        NoAnswer(key="robot/arm/1", seconds=5.0),
        SlotEmpty(robot="x", slot="arm", reason="lost", kind="Arm"),
    ],
)
@pytest.mark.parametrize("name", ["grip", "disguise"])
def test_an_end_or_a_doubt_is_never_repeated(name: str, error: VrError) -> None:
    team = stubborn(error, None)
    with pytest.raises(VrError):
        team.call(name)
    assert attempts(team) == 1


def test_an_error_of_the_pages_own_is_repeated() -> None:
    team = stubborn(Failed("one"), None)
    team.call("disguise")
    assert attempts(team) == 2


def test_a_mistake_of_the_page_is_not_repeated() -> None:
    team = stubborn(None)
    with pytest.raises(CommandFailed, match="a mistake"):
        team.call("mistake")
    assert attempts(team) == 1


def test_the_limit_of_a_call_is_not_repeated() -> None:
    team = rehearse(Stubborn, arm=Fake(Arm, takes=9.0))
    with pytest.raises(ChildTimeout):
        team.call("go", limit=0.5)
    assert attempts(team) == 1


@pytest.mark.parametrize("what", ["cancel", "stop"])
@pytest.mark.parametrize("after", [0.05, 0.5])
def test_a_cancel_or_a_stop_ends_the_call_and_the_wait(what: str, after: float) -> None:
    team = stubborn(Failed("one"), None)
    going = team.start("grip")
    team.wait(after)
    getattr(team, what)()
    with pytest.raises(CommandCancelled):
        going.result()
    team.wait(10.0)
    assert attempts(team) == 1


def test_the_deadline_ends_the_wait() -> None:
    team = stubborn(Failed("one"), None)
    with pytest.raises(DeadlineExceeded):
        team.call("grip", within=0.5)
    assert attempts(team) == 1


def test_a_child_that_is_cancelled_alone_or_lost_is_not_asked_again() -> None:
    team = rehearse(Stubborn, arm=Fake(Arm, takes=5.0))
    going = team.start("grip")
    team.wait(1.0)
    team.lose("arm")
    with pytest.raises(SlotEmpty):
        going.result()
    assert attempts(team) == 1
    team = stubborn(CommandCancelled("its operator"), None)
    with pytest.raises(ChildCancelled):
        team.call("grip")
    assert attempts(team) == 1


def test_what_is_written_wrongly_is_refused() -> None:
    with pytest.raises(TypeError, match="give how often"):
        retry(times=0)
    with pytest.raises(ValueError, match="is no time"):
        retry(times=2, backoff=-1)
    with pytest.raises(TypeError, match="write @command above @retry"):
        retry(times=2)(command(lambda_named))


def lambda_named(robot: object) -> None:
    """Do nothing."""
