"""The stage on which the thesis' scenario is played: real processes and the real full screen."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import os
import signal
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from textual.pilot import Pilot
from textual.widgets import Button, DirectoryTree, Input

from robotree.client.joining import joined
from robotree.tui.processes.crew import Crew
from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.vr.supervision.realm_client import RealmClient
from tests.screen import press, shows, text_of
from tests.terminal import Terminal

SWITCHED_OFF = "tcp:127.0.0.1:9"
"""Where no controller listens: a rover that nobody moves needs no simulated floor."""


async def arm_cell(crew: Crew, speedup: str) -> None:
    """Start the processes of the demo's cell; its rover is switched off."""
    table = await crew.start(
        "sim", "arm", "--listen", "tcp:127.0.0.1:0", "--state", "none", "--speedup", speedup
    )
    await crew.start_all(
        ("lookup", "lookup-1"),
        ("directory", "directory-1"),
        ("host", "host-1"),
        ("view", "cell", "--connect", table.address),
        ("proxy", "arm", "arm-1", "--connect", table.address),
        ("proxy", "rover", "rover-1", "--connect", SWITCHED_OFF),
    )


@pytest.fixture
def terminals() -> Iterator[list[Terminal]]:
    """Takes terminals that end with the test, and with them all that was started there."""
    found: list[Terminal] = []
    yield found
    for each in found:
        family = each.family()
        each.close()
        for pid in family:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        each.wait()


class Stage:
    """An operator at the keyboard of the full screen."""

    def __init__(self, pilot: Pilot[int], realm_client: RealmClient) -> None:
        self.app: Supervisor = pilot.app  # type: ignore[assignment] # the app that was run
        self.realm_client = realm_client
        self._pilot = pilot
        self._context = contextvars.copy_context()

    async def play(self, doing: Coroutine[Any, Any, Any]) -> Any:
        """Do something in the context in which the app runs."""
        return await asyncio.get_running_loop().create_task(doing, context=self._context)

    async def press(self, *keys: str) -> None:
        """Press keys, as a person who has seen what is in front."""
        await self.until(
            lambda: self.app.now() >= self.app.guard.seen and not self.app.selection.refusal(self.app.now())
        )
        await self.play(press(self._pilot, *keys))

    async def until(self, holds: Callable[[], bool], within: float = 60.0) -> None:
        """Wait until the screen shows something; its drawing says when to look."""
        try:
            async with asyncio.timeout(within):
                while not holds():
                    await self.play(self._pilot.pause(0.05))
        except TimeoutError:
            pytest.fail(f"it did not come to that within {within:g} s:\n{self.text}")

    async def sees(self, *words: str, within: float = 60.0) -> None:
        """Wait until all words are on the screen."""
        await self.until(lambda: shows(self.text, words), within)

    @property
    def text(self) -> str:
        """What is on the screen, without colours."""
        return text_of(self.app)

    @property
    def listed(self) -> set[str]:
        return set(self.app.store.robots)

    # -- what the operator does again and again ----------------------------------------------------

    async def main_page(self) -> None:
        for _ in range(4):
            if isinstance(self.app.screen, MainPage):
                break
            await self.press("escape")
        assert isinstance(self.app.screen, MainPage)
        await self.press("l")

    async def select(self, name: str) -> None:
        """Move the cursor of the list to a robot."""
        await self.main_page()
        table = self.app.screen.query_one(RobotTable)
        await self.until(lambda: name in table.names)
        await self.press("ctrl+home")
        for _ in range(table.row_count):
            if table.selected == name:
                return
            await self.press("down")
        pytest.fail(f"{name} cannot be selected:\n{self.text}")

    async def choose_file(self, name: str) -> None:
        """Open the page for new robots and walk to a file of the examples."""
        await self.main_page()
        await self.press("n")
        await self.sees("new virtual robot", name)
        tree = self.app.screen.query_one(DirectoryTree)
        await self.press("home")
        for _ in range(20):
            node = tree.cursor_node
            if node and node.data and node.data.path.name == name:
                break
            await self.press("down")
        await self.press("enter")
        await self.until(lambda: not self.app.screen.query_one("#create", Button).disabled)

    async def name_it(self, name: str) -> None:
        """Overwrite the suggested name and create the robot."""
        entry = self.app.screen.query_one("#name", Input)
        await self.press("home", "shift+end", "delete", *name, "enter")
        await self.until(lambda: name in self.listed)
        assert entry.value == name

    async def enslave(self, parent: str, child: str) -> None:
        await self.select(parent)
        await self.press("e")
        await self.sees(child)
        await self.press("enter")
        await self.until(lambda: child not in self.listed)

    async def panel(self, name: str) -> PanelPage:
        await self.select(name)
        await self.press("enter")
        await self.until(lambda: isinstance(self.app.screen, PanelPage))
        page = self.app.screen
        assert isinstance(page, PanelPage)
        return page

    async def run_command(self, page: PanelPage, name: str, within: float) -> None:
        """Go to a command of the panel and run it."""
        await self.press("ctrl+l", "home")
        for command in page.robot.commands:
            if command.name == name:
                break
            await self.press("down")
        await self.press("ctrl+r")
        await self.sees("done in", within=within)

    async def jog(self, *keys: str, within: float = 60.0) -> None:
        """Press jog keys, each when the step before has been made."""
        page = self.app.screen
        assert isinstance(page, TeleopPage)
        for key in keys:
            before = page.jog.fulfilled
            await self.press(key)
            await self.until(lambda seen=before: page.jog.fulfilled not in (None, seen), within)

    def target(self) -> dict[str, float]:
        """Where the jog keys have led so far."""
        page = self.app.screen
        assert isinstance(page, TeleopPage)
        return page.jog.target or self.readings(page.robot.name)

    async def lever(self) -> float:
        """[rad] The angle that the workspace's instrument reads."""
        return (await self.realm_client.describe_view("cell")).readings["lever"]

    def readings(self, name: str) -> dict[str, float]:
        return self.app.store.readings(name)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def stage(shared_place: Path) -> AsyncIterator[Stage]:
    async with Crew("thesis", shared_place) as crew:
        await arm_cell(crew, "4")
        async with (
            joined("thesis") as realm_client,
            Supervisor(realm_client, realm="thesis").run_test(size=(140, 44)) as pilot,
        ):
            yield Stage(pilot, realm_client)
