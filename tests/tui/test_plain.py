"""The supervisor in lines: what it says, what it asks, and that nothing is drawn."""

from __future__ import annotations

import asyncio
import os
import re
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotree.tui.supervising import Lines, spoken
from tests.terminal import Person
from tests.waiting import until

if TYPE_CHECKING:
    from conftest import Realm

DRAWN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f\u2500-\u259f\u2800-\u28ff\u25a0-\u25ff]")
"""Escapes, boxes, blocks, braille and signs."""
SAID = Callable[[], str]


@pytest.fixture
async def lines(
    realm: Realm, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[tuple[Lines, SAID]]:
    out, into = os.pipe()
    keyboard = os.fdopen(out)
    monkeypatch.setattr("sys.stdin", keyboard)
    plain, heard = Lines(realm.realm_client, "shop", readonly=False), list[str]()

    def said() -> str:
        heard.append(capsys.readouterr().out)
        return "".join(heard)

    running = asyncio.create_task(plain.last())
    await until(lambda: "arm-1: free" in said(), "the arm is said")
    yield plain, said
    os.write(into, b"quit\n")
    await running
    os.close(into)
    keyboard.close()


async def test_each_change_is_one_line_and_what_stays_is_said_once(lines: tuple[Lines, SAID]) -> None:
    plain, said = lines
    plain.take("create examples/move_to.py as mover")
    await until(lambda: "mover: needs arm: Arm" in said(), "a new robot is said with what it needs")
    plain.take("enslave mover.arm arm-1")
    await until(lambda: "arm-1: under mover" in said(), "who commands is said")
    assert said().count("rover-1: free") == 1
    plain.take("tree")
    await until(lambda: "arm-1" in said().rpartition("tree")[2], "the tree is said")
    assert not DRAWN.search(said())


async def test_nothing_is_said_of_a_robot_before_it_has_said_how_it_is(
    lines: tuple[Lines, SAID], realm: Realm
) -> None:
    plain, _ = lines
    fresh = Lines(realm.realm_client, "shop", readonly=False)
    fresh.store.take_lists(list(plain.store.robots.values()), [], 1.0)
    assert {"arm-1", "rover-1"} <= fresh.store.known
    assert not [line for line in fresh.changes(2.0) if "free" in line]
    fresh.store.take_descriptions(plain.store.descriptions.values(), 2.0)
    assert "arm-1: free" in fresh.changes(3.0)


async def test_what_takes_away_asks_first_and_only_yes_does_it(lines: tuple[Lines, SAID]) -> None:
    plain, said = lines
    plain.take("create examples/move_to.py as mover")
    await until(lambda: "mover: " in said())
    plain.take("delete mover")
    assert "delete mover? Type yes" in said()
    plain.take("no")
    assert "Not done." in said()
    assert "mover: no longer here" not in said()
    plain.take("delete mover")
    plain.take("yes")
    await until(lambda: "mover: no longer here" in said(), "it is deleted")


async def test_a_stop_is_done_at_once_and_said(lines: tuple[Lines, SAID]) -> None:
    plain, said = lines
    plain.take("stop")
    await until(lambda: "arm-1: stopped" in said() and "rover-1: stopped" in said(), "both stand")
    plain.store.tell("arm-1 is in anna@pts/3's protective stop", "error", time.monotonic())
    await until(lambda: "Attention: arm-1 is in anna@pts/3's" in said(), "the log says it")
    assert "Error:" not in said(), "a stop that was done is no error"


async def test_mistakes_get_a_sentence_and_help_names_every_verb(lines: tuple[Lines, SAID]) -> None:
    plain, said = lines
    for typed, sentence in (
        ("dance", "Error: no verb 'dance'"),
        ("show nobody", "Error: "),
        ("call arm-1.go_to x=9km", "Error: "),
        ("enslave 'a", "Error: "),
        ("panel", "full screen"),
    ):
        before = len(said())
        plain.take(typed)
        await until(lambda before=before, sentence=sentence: sentence in said()[before:], typed)
    plain.take("help")
    assert "quit: Leave" in said()
    topics = dict(line.split(": ", 1) for line in said().splitlines() if ": " in line)
    for topic, actions in plain.surface.groups.items():
        if verbs := [one.verb for one in actions if one.run]:
            assert topics[topic] == ", ".join(verbs)
    assert len(said().splitlines()) < 40, "a person hears it all"
    for about, sentence in (
        ("command", "stop [NAME] [--everywhere]: Protective stop"),
        ("resume", "Example: resume"),
        ("dance", "'dance' is no verb and no topic"),
    ):
        plain.take(f"help {about}")
        assert sentence in said()


def test_what_is_only_drawn_is_left_out_and_the_tree_keeps_its_indent() -> None:
    assert spoken("├─ arm-1\n│  └─ jaw") == "   arm-1\n      jaw"
    assert spoken("⠋ 40 % ▁▂▃").strip() == "40 %"


@pytest.mark.e2e
@pytest.mark.usefixtures("place")
def test_a_person_at_a_real_terminal_hears_lines_and_leaves() -> None:
    host = Person("plain", "host", "host-1")
    reader = Person("plain", "--plain")
    try:
        host.shows(b"ready")
        reader.shows(b"Type help for all verbs")
        page = Path(__file__).parents[2] / "examples" / "move_to.py"
        reader.types(f"create {page} as mover\n", sees="mover: needs arm: Arm")
        reader.types("stop\n", sees="mover: stopped")
        shown = reader.shown
        reader.types("quit\n", sees="quit")
        reader.wait()
        assert not DRAWN.search(shown.decode().replace("\r", "")), shown
    finally:
        reader.leave()
        host.leave()
