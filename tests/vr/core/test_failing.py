"""The reason that an author gives when a command cannot succeed, and what its callers read."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robotree.vr import (
    BadArgument,
    Child,
    ChildCancelled,
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    Failed,
    Robot,
    SlotEmpty,
    VirtualRobot,
    VrError,
    command,
)
from robotree.vr.base.requests import Raised

PLACES = {1: "left"}


class ShelfEmpty(Failed):
    """An author's own kind of failure."""


class Shelf(Robot):
    """Fails in all ways."""

    @command
    def fetch(self, how: str) -> None:  # noqa: C901 # a list of examples
        match how:
            case "said":
                raise Failed("the shelf is empty", shelf=3)
            case "plain":
                raise CommandFailed("the shelf is empty")
            case "argument":
                raise BadArgument("shelf", "is beyond the reach")
            case "doubt":
                raise CommandInDoubt("the gripper may hold it")
            case "own":
                raise ShelfEmpty("nothing in it", shelf=4)
            case "odd":
                raise Failed("odd", what=object())
            case "robot":
                raise Failed("it does not answer", robot="rover-1")
            case "from":
                try:
                    PLACES[3]
                except KeyError as error:
                    raise Failed("there is no place 3") from error
            case "while":
                try:
                    PLACES[3]
                except KeyError:
                    self.look_up()
            case _:
                self.look_up()

    def look_up(self) -> None:
        raise ValueError("no such place")


class Fetcher(VirtualRobot):
    """Commands a shelf."""

    shelf = Child("Shelf")

    @command
    def fetch(self, how: str) -> None:
        self.shelf.fetch(how=how)

    @command
    def wrong(self) -> None:
        self.shelf.fetch(why="said")

    @command
    def catch(self) -> str:
        try:
            self.shelf.fetch(how="said")
        except Failed as error:
            return f"{error.detail} {error.shelf}"
        return ""


@pytest.fixture
async def fetcher(homes: Any) -> Any:
    return homes.client(await homes.team(Fetcher("fetcher"), shelf=Shelf("shelf-1")))


async def failure(client: Any, command: str, **arguments: Any) -> VrError:
    with pytest.raises(VrError) as caught:
        await client.call(command, arguments)
    return caught.value


@pytest.mark.parametrize(
    ("how", "kind", "sentence"),
    [
        ("said", Failed, "shelf-1.fetch failed: the shelf is empty (shelf=3)"),
        ("plain", CommandFailed, "shelf-1.fetch failed: the shelf is empty"),
        ("argument", BadArgument, "shelf-1.fetch: shelf: is beyond the reach"),
        ("doubt", CommandInDoubt, "shelf-1.fetch may have been carried out or not: the gripper may hold it"),
        ("own", Failed, "shelf-1.fetch failed: nothing in it (shelf=4) (ShelfEmpty)"),
        ("robot", Failed, "shelf-1.fetch failed: it does not answer (robot=rover-1)"),
        ("from", Failed, "shelf-1.fetch failed: there is no place 3"),
    ],
)
async def test_an_author_raises_an_error_as_the_guide_writes_it(
    fetcher: Any, how: str, kind: type[VrError], sentence: str
) -> None:
    error = await failure(fetcher, "fetch", how=how)
    assert type(error) is kind
    assert str(error) == sentence


async def test_an_error_reads_well_before_it_leaves_its_page() -> None:
    assert str(Failed("the shelf is empty", shelf=3)) == "failed: the shelf is empty (shelf=3)"
    assert str(BadArgument("x", "is too far")) == "x: is too far"
    with pytest.raises(TypeError, match="CommandFailed takes detail"):
        CommandFailed("one", "two")
    with pytest.raises(AttributeError, match="this failure has no 'shelf'; it has: detail, box"):
        _ = Failed("no", box=1).shelf


async def test_a_parent_catches_a_failure_and_reads_its_values(fetcher: Any) -> None:
    assert await fetcher.call("catch", {}) == "the shelf is empty 3"


async def test_a_value_that_cannot_travel_is_told_in_words(fetcher: Any) -> None:
    error = await failure(fetcher, "fetch", how="odd")
    assert isinstance(error, Failed)
    assert error.what.startswith("<object object")


def test_a_failure_travels_with_its_values() -> None:
    error = Failed("empty", shelf=3, robot="rover-1")
    error.fill_in("shelf-1", "fetch")
    again = Raised.of(error).revive()
    assert isinstance(again, Failed)
    assert (str(again), again.data, again.robot) == (str(error), error.data, "rover-1")


async def test_a_failure_keeps_the_lines_of_all_pages_on_its_way(fetcher: Any) -> None:
    error = await failure(fetcher, "fetch", how="otherwise")
    fetch, shelf_fetch, look_up = (line for line in error.trace if line.startswith(" "))
    assert [line for line in error.trace if not line.startswith(" ")] == ["fetcher.fetch", "shelf-1.fetch"]
    assert fetch.endswith("in fetch: self.shelf.fetch(how=how)")
    assert shelf_fetch.startswith("  test_failing.py, line ")
    assert shelf_fetch.endswith("in fetch: self.look_up()")
    assert look_up.endswith('in look_up: raise ValueError("no such place")')


async def test_a_failure_keeps_its_cause(fetcher: Any) -> None:
    error = await failure(fetcher, "fetch", how="from")
    asked = error.trace.index("because of KeyError: 3")
    assert error.trace[asked + 1].endswith("in fetch: PLACES[3]")
    error = await failure(fetcher, "fetch", how="while")
    handled = error.trace.index("while handling KeyError: 3")
    assert error.trace[handled + 1].endswith("in fetch: PLACES[3]")


async def test_wrong_arguments_for_a_child_name_the_line_of_the_page(fetcher: Any) -> None:
    error = await failure(fetcher, "wrong")
    line = next(line for line in error.trace if "why" in line).split(",")[1].split()[-1]
    assert isinstance(error, BadArgument)
    assert str(error).endswith(f"it takes how (test_failing.py, line {line})")


async def test_the_log_shows_the_lines_of_the_page_alone(
    fetcher: Any, caplog: pytest.LogCaptureFixture
) -> None:
    await failure(fetcher, "fetch", how="otherwise")
    told = caplog.records[0].getMessage()
    assert told.startswith("shelf-1.fetch failed: ValueError: no such place (")
    assert "worker.py" not in told
    assert "look_up" in told
    assert caplog.records[0].exc_info is None


# -- three ways to lose a child's command ------------------------------------------------------------


class Slow(Robot):
    """Takes its time."""

    @command
    def work(self) -> None:
        self.sleep(10)


class Boss(VirtualRobot):
    """Says what became of its child's command."""

    child = Child("Slow")

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.seen: list[type[BaseException]] = []

    @command
    def work(self) -> None:
        try:
            self.child.work()
        except VrError as error:
            self.seen.append(type(error))
            raise


@pytest.mark.parametrize(
    ("what", "kind", "sentence"),
    [
        (
            "the child's call",
            ChildCancelled,
            "slow.work was cancelled alone, not the command that called it: enough",
        ),
        ("the bond", SlotEmpty, "boss.child is empty (slow was released)"),
        ("the command", CommandCancelled, "boss.work was cancelled: enough"),
    ],
)
@pytest.mark.usefixtures("homes")
async def test_three_things_that_end_a_call_of_a_child_say_which_they_are(
    realm: Any, what: str, kind: type[VrError], sentence: str
) -> None:
    boss = await realm.team(Boss("boss"), child=Slow("slow"))
    slow = boss.child
    working = asyncio.create_task(realm.client(boss).call("work", {}, key="k"))
    await realm.until(lambda: slow.description().busy == "work")
    match what:
        case "the child's call":
            slow.runtime.cancel("k/1", "enough")
        case "the bond":
            await realm.client(boss).free("child")
        case _:
            await realm.client(boss).cancel("k", reason="enough")
    with pytest.raises(kind) as caught:
        await working
    assert str(caught.value).startswith(sentence)
    assert boss.robot.seen == [kind]
