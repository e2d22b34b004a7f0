"""The screen in a real browser: at a telephone, in tabs that close, freeze and crash, and among others."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.browser import WITHOUT, Browser, Keys, open_browser
from tests.command_line import ROBOTREE, robotree
from tests.waiting import wait_until

__all__ = ["open_browser"]
pytestmark = [pytest.mark.e2e, pytest.mark.skipif(bool(WITHOUT), reason=WITHOUT)]

PAGE = '''
from pathlib import Path

from robotree.vr import VirtualRobot, command


class Waiter(VirtualRobot):
    """Waits, and notes when it begins and when it has ended."""

    @command
    def wait(self, file: str) -> None:
        """Wait until somebody cancels it."""
        Path(file).write_text("waits")
        try:
            self.sleep(100_000)
        finally:
            Path(file).write_text("ended")
'''


@contextmanager
def started(*words: str) -> Generator[str]:
    """Run a process of robotree for the time of a block; yield the first line of its output."""
    with subprocess.Popen(
        [*ROBOTREE, *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline()
        finally:
            process.terminate()


@pytest.fixture
def addresses(place: Path) -> Iterator[dict[str, str]]:
    """A realm with a robot that waits, and the addresses at which browsers find it."""
    page = place / "waiter.py"
    page.write_text(PAGE)
    with (
        started("lookup", "lookup-1"),
        started("host", "host-1"),
        started("web", "--listen", "0", "--json") as line,
    ):
        assert robotree("create", page, "as", "waiter").returncode == 0
        yield json.loads(line)


def begin(browser: Browser, note: Path) -> None:
    """Have the robot begin to wait."""
    browser.shows("waiter", "free")
    browser.types(f":call waiter.wait file={note}", Keys.ENTER)
    says(note, "waits")


def says(note: Path, words: str) -> None:
    wait_until(lambda: note.exists() and note.read_text() == words, f"the robot notes that it {words}")


def test_a_person_commands_from_a_telephone_and_what_began_ends_with_the_tab(
    addresses: dict[str, str], place: Path, open_browser: Callable[[], Browser]
) -> None:
    browser, note = open_browser(), place / "note"
    browser.be_a_phone()
    browser.driver.get(addresses["command"])
    begin(browser, note)
    assert browser.driver.current_url == addresses["command"].partition("#")[0], "the token is not to be seen"
    loaded = browser.run("return performance.getEntriesByType('resource').map(one => new URL(one.name).host)")
    assert set(loaded) == {urlsplit(addresses["command"]).netloc}, "nothing comes from elsewhere"
    assert browser.run("return document.documentElement.scrollWidth <= innerWidth")
    browser.touches("?")
    browser.shows("Protective stop")
    browser.touches("Esc")
    browser.shows("waiter")
    first = browser.driver.current_window_handle
    browser.driver.switch_to.new_window("tab")
    browser.driver.get(addresses["watch"])
    browser.shows("read-only", "waiter")
    browser.driver.switch_to.window(first)
    browser.driver.close()
    says(note, "ended")
    browser.driver.switch_to.window(browser.driver.window_handles[0])
    browser.types("?")
    browser.shows("Protective stop")  # the other tab goes on
    browser.types(Keys.CONTROL + "q")
    browser.shows("The screen has been left", at="told")
    browser.run("document.getElementById('again').click()")
    browser.shows("waiter", "free")


def test_what_began_ends_with_a_tab_that_freezes_and_with_a_browser_that_is_killed(
    addresses: dict[str, str], place: Path, open_browser: Callable[[], Browser]
) -> None:
    frozen, killed = place / "frozen", place / "killed"
    browser = open_browser()
    browser.driver.get(addresses["command"])
    begin(browser, frozen)
    browser.command("Page.setWebLifecycleState", state="frozen")
    says(frozen, "ended")
    browser.command("Page.setWebLifecycleState", state="active")
    browser.shows("what this tab had begun", at="told")
    browser.driver.switch_to.new_window("tab")
    browser.driver.get(addresses["command"])
    begin(browser, killed)
    assert killed.read_text() == "waits"
    browser.kill()
    says(killed, "ended")
