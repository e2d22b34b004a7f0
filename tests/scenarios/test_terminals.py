"""Terminals that close, stall or are missing: what was started for a person ends with the person's screen."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from robotree.tui.demo_companion import ROBOT, SCRIPT
from tests.command_line import ROBOTREE
from tests.terminal import Terminal, living
from tests.withheld import Withheld

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("place")]

LED_BY_MAKE = "make"
"""The session's leader is `make`, as in `xterm -e make demo`: it alone gets the hang-up signal, and waits."""
END = 3.0
"""[s] in which everything has to be gone; what threads waited for a processor is forgiven."""
CREW = 8 + 3
"""Processes of the demo: two controllers, two proxies, a view, two lookup services, a host; and the guards of
proxies and host."""
STARTED = b"starting the demo"
SCREEN = b"\x1b[?1049h"
"""Textual turns to the terminal's other screen: it is there, and draws."""
LISTED = b"arm-1"


@pytest.fixture
def open_terminal(terminals: list[Terminal]) -> Callable[..., Terminal]:
    def opened(*words: str) -> Terminal:
        terminals.append(Terminal(*words))
        return terminals[-1]

    return opened


def led_by_make(folder: Path, *words: str) -> tuple[str, ...]:
    """Return the line that starts `robotree WORDS…` beneath `make`."""
    if not shutil.which(LED_BY_MAKE):
        pytest.skip("without make there is nobody to lead the session")
    makefile = folder / "Makefile"
    makefile.write_text(f"it:\n\t@{' '.join((*ROBOTREE, *words))}\n")
    return (LED_BY_MAKE, "-f", str(makefile), "it")


def gone(terminal: Terminal, family: list[int]) -> None:
    """Check that no process of the family runs after `END`."""
    began, withheld, lost = time.monotonic(), Withheld(*family), 0.0
    while left := [pid for pid in family if living(pid)]:
        terminal.is_over()
        lost = max(lost, withheld.seconds)
        assert time.monotonic() < began + END + lost, f"{len(left)} of {len(family)} still live"
        time.sleep(0.02)


def test_a_demo_ends_with_its_terminal_and_leaves_nobody(
    tmp_path: Path, open_terminal: Callable[..., Terminal]
) -> None:
    terminal = open_terminal(*led_by_make(tmp_path, "demo", "--realm", "closed"))
    terminal.shows(LISTED)
    family = terminal.family()
    assert len(family) == 2 + CREW, "make, the demo, and its crew"
    terminal.close()
    gone(terminal, family)


def test_the_demo_of_the_companion_shows_its_next_step_and_the_robots_that_it_names(
    open_terminal: Callable[..., Terminal],
) -> None:
    terminal = open_terminal(*ROBOTREE, "demo", "companion", "--realm", "flat", "--speedup", "3")
    terminal.shows(SCREEN)
    terminal.shown = terminal.shown.partition(SCREEN)[2]  # what was written before it is not on the screen
    terminal.shows(f"next: select {SCRIPT}, ⏎ opens its panel, ^r runs start".encode())
    terminal.shows(ROBOT.encode())
    terminal.shows(b"Evening")  # the kind of the script, in its row
    assert b"Traceback" not in terminal.shown


def test_a_demo_whose_terminal_closes_while_it_starts_leaves_nobody_after_many_signals(
    tmp_path: Path, open_terminal: Callable[..., Terminal]
) -> None:
    terminal = open_terminal(*led_by_make(tmp_path, "demo", "--realm", "closed"))
    terminal.shows(STARTED)
    family = terminal.family()
    terminal.close()
    for one in (signal.SIGHUP, signal.SIGTERM, signal.SIGHUP):
        os.killpg(terminal.pid, one)  # as a window's program and a tidy shell do
    gone(terminal, family)
    assert not any(living(pid) for pid in family)


def test_the_plain_screen_ends_with_its_terminal(
    open_terminal: Callable[..., Terminal],
) -> None:
    terminal = open_terminal(*ROBOTREE, "--realm", "closed")
    terminal.shows(SCREEN)
    family = terminal.family()
    terminal.close()
    gone(terminal, family)
    assert not any(living(pid) for pid in family)


def test_a_screen_whose_terminal_takes_nothing_more_still_ends_when_it_is_told_to(
    open_terminal: Callable[..., Terminal],
) -> None:
    terminal = open_terminal(*ROBOTREE, "--realm", "stalled")
    terminal.shows(SCREEN)
    terminal.stalls()
    os.kill(terminal.pid, signal.SIGTERM)
    began = time.monotonic()
    while not terminal.is_over():
        assert time.monotonic() < began + 60, "SIGTERM has no effect"
        time.sleep(0.1)
