"""`--watch`: an author saves, and the robot goes on with the page; with a mistake it keeps the old one."""

from __future__ import annotations

import asyncio
import json
import os
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotree.tui.errors import BadLine
from robotree.tui.line import grammar, sources
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.carrying import function_of
from robotree.tui.line.surface import Surface
from robotree.vr.base.errors import NoSuchRobot
from robotree.vr.world.testing import until
from tests.tui.test_verbs import Listener

if TYPE_CHECKING:
    from conftest import Realm

PAGE = """
from robotree.vr import VirtualRobot, command
from helper import WORD

class Team(VirtualRobot):
    @command
    def say(self) -> str:
        return "{word} " + WORD

    @command
    def wait(self, seconds: float) -> str:
        self.progress(0.1)
        self.sleep(seconds)
        return "{word}"
"""


def write(path: Path, text: str) -> None:
    path.write_text(text)


def rename(path: Path, text: str) -> None:
    """Save as most editors do: write another file, and rename it."""
    other = path.with_name(f".{path.name}.swp")
    other.write_text(text)
    other.replace(path)


def move_away(path: Path, text: str) -> None:
    """Save as editors do that keep a copy: the page is not there for a moment."""
    path.rename(path.with_name(f"{path.name}~"))
    path.write_text(text)


class Author:
    """Edits a page beside a robot that is created or reloaded with `--watch`."""

    def __init__(self, realm: Realm, folder: Path) -> None:
        self.realm, self.page, self.helper = realm, folder / "team.py", folder / "helper.py"
        self.listener = Listener()
        self.page.write_text(PAGE.format(word="first"))
        self.helper.write_text("WORD = 'one'\n")
        self.watching: asyncio.Task[object] | None = None

    async def watch(self, text: str) -> None:
        line = grammar.parse(grammar.split(text), shapes(Where.SHELL), {"json": ""})
        self.watching = asyncio.ensure_future(
            function_of(line.verb)(self.realm.realm_client, line, self.listener)  # type: ignore[arg-type]
        )
        await until(lambda: "is saved" in self.texts or self.watching_ended, "it watches")
        self.listener.outcomes.clear()

    @property
    def watching_ended(self) -> bool:
        return self.watching is None or self.watching.done()

    @property
    def texts(self) -> str:
        return "\n".join(outcome.text for outcome in self.listener.outcomes)

    async def told(self, words: str) -> dict[str, object]:
        """Wait for an outcome with these words; return its plain data, which is one line of JSON."""
        await until(lambda: words in self.texts or self.watching_ended, words)
        assert not self.watching_ended
        outcome = next(one for one in self.listener.outcomes if words in one.text)
        self.listener.outcomes.clear()
        assert "\n" not in json.dumps(outcome.data)
        data: dict[str, object] = outcome.data
        return data

    async def said(self) -> object:
        return await self.realm.realm_client.call("team", "say", {})


@pytest.fixture
async def author(realm: Realm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Author]:
    monkeypatch.setattr(sources, "PERIOD", 0.01)
    monkeypatch.setattr(sources, "SETTLE", 0.002)
    author = Author(realm, tmp_path)
    yield author
    if author.watching is not None:
        author.watching.cancel()
        await asyncio.gather(author.watching, return_exceptions=True)


@pytest.mark.parametrize("save", [write, rename, move_away])
async def test_a_page_is_reloaded_each_time_that_it_is_saved(
    author: Author, save: Callable[[Path, str], None]
) -> None:
    await author.watch(f"create '{author.page}' as team --watch")
    assert await author.said() == "first one"
    for word in ("second", "third time"):
        save(author.page, PAGE.format(word=word))
        data = await author.told("team goes on with")
        assert (data["reloaded"], data["page"]) == ("team", str(author.page))
        assert await author.said() == f"{word} one"


async def test_a_saved_helper_reloads_the_page_and_new_ones_are_watched_too(author: Author) -> None:
    await author.watch(f"create '{author.page}' as team --watch")
    rename(author.helper, "WORD = 'other'\n")
    await author.told("team goes on with")
    assert await author.said() == "first other"
    rename(author.helper, "from parts.words import WORD\n")
    data = await author.told("No module named 'parts'")
    assert (data["file"], data["line"]) == (str(author.helper), 1)
    (author.page.parent / "parts").mkdir()
    write(author.page.parent / "parts" / "words.py", "WORD = 'new'\n")
    await author.told("team goes on with")
    assert await author.said() == "first new"


async def test_a_mistake_is_told_with_page_and_line_and_the_old_page_goes_on(author: Author) -> None:
    await author.watch(f"create '{author.page}' as team --watch")
    write(author.page, PAGE.format(word="second").replace("def say(self) -> str:", "def say(self) -> str"))
    data = await author.told("cannot be loaded: line 7: expected ':' (this host runs Python ")
    assert (data["name"], data["file"], data["line"]) == ("team", str(author.page), 7)
    assert await author.said() == "first one"
    write(author.page, PAGE.format(word="right"))
    await author.told("team goes on with")
    assert await author.said() == "right one"


async def test_what_is_saved_as_it_was_is_no_news(author: Author) -> None:
    await author.watch(f"create '{author.page}' as team --watch")
    os.utime(author.page)
    rename(author.helper, author.helper.read_text())
    (author.page.parent / "notes.txt").write_text("beside it")
    write(author.page, PAGE.format(word="news"))
    await author.told("team goes on with")
    assert author.listener.outcomes == []
    assert await author.said() == "news one"


async def test_a_page_that_is_saved_while_a_command_runs_is_taken_over_when_it_ends(author: Author) -> None:
    await author.realm.realm_client.create(str(author.page), "team")
    await author.watch("reload team --watch")
    begun, realm_client = asyncio.Event(), author.realm.realm_client
    call = realm_client.call("team", "wait", {"seconds": 60.0}, on_progress=lambda _, __: begun.set())
    running = asyncio.ensure_future(call)
    await begun.wait()
    write(author.page, PAGE.format(word="second"))
    await until(lambda: bool(author.listener.warnings), "a warning")
    assert author.listener.warnings == ["team.wait is running: the page is taken over when it has ended"]
    assert author.listener.outcomes == []
    await realm_client.cancel("team")
    await asyncio.gather(running, return_exceptions=True)
    await author.told("team goes on with")
    assert await author.said() == "second one"


async def test_a_robot_that_is_deleted_ends_the_watch(author: Author) -> None:
    await author.realm.realm_client.create(str(author.page), "team")
    await author.watch(f"reload team '{author.page}:Team' --now --watch")
    await author.realm.realm_client.delete("team")
    write(author.page, PAGE.format(word="second"))
    assert author.watching is not None
    with pytest.raises(NoSuchRobot):
        await author.watching


async def test_a_broken_page_can_be_watched_until_it_is_right(author: Author) -> None:
    await author.realm.realm_client.create(str(author.page), "team")
    write(author.page, "import nowhere_at_all\n")
    await author.watch("reload team --watch")
    write(author.page, PAGE.format(word="second"))
    await author.told("team goes on with")
    assert await author.said() == "second one"


@pytest.mark.parametrize("where", [Where.PROMPT, Where.SCRIPT])
def test_it_is_for_a_shell_alone(where: Where) -> None:
    with pytest.raises(BadLine, match="--watch works in a shell, not"):
        Surface(where).parse(["reload", "team", "--watch"])


async def test_a_page_that_is_just_being_written_after_a_mistake_is_read_when_that_is_done(
    author: Author, monkeypatch: pytest.MonkeyPatch
) -> None:
    await author.watch(f"create '{author.page}' as team --watch")
    write(author.page, PAGE.format(word="second").replace("def say(self) -> str:", "def say(self) -> str"))
    await author.told("cannot be loaded: line 7: expected ':' (this host runs Python ")
    read, halfway = sources.PageFiles.read, threading.Event()

    def while_it_is_written(files: sources.PageFiles) -> None:
        """The first look at the files was before the editor began; it ends a moment later."""
        if not halfway.is_set():
            author.page.write_text("")
            halfway.set()
        read(files)

    monkeypatch.setattr(sources.PageFiles, "read", while_it_is_written)
    await until(halfway.is_set, "the editor has begun")
    write(author.page, PAGE.format(word="right"))
    await author.told("team goes on with")
    assert await author.said() == "right one"
