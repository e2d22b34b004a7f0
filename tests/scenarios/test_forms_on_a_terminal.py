"""Forms on a real terminal: keys come as bytes, many at once, and robots in processes of their own obey."""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from robotree.client.joining import joined
from robotree.tui.processes.crew import Crew
from robotree.vr.supervision.fleet import Fleet
from robotree.vr.world.testing import until
from tests.command_line import ROBOTREE
from tests.scenarios.test_terminals import Terminal

pytestmark = [pytest.mark.e2e, pytest.mark.asyncio(loop_scope="module"), pytest.mark.timeout(120)]

REALM = "forms"
ENTER, TAB, BACKSPACE, DOWN, RIGHT = "\r", "\t", "\x7f", "\x1b[B", "\x1b[C"
CTRL_R, CTRL_S, CTRL_U = "\x12", "\x13", "\x15"


class Operator(Terminal):
    """A person at a terminal with the full screen in it."""

    def __init__(self) -> None:
        super().__init__(*ROBOTREE, "--realm", REALM)

    def types(self, keys: str, *, sees: str) -> None:
        """Press keys, all at once, and wait for words that are drawn after it."""
        self.shown = b""
        os.write(self._master, keys.encode())
        self.shows(sees.encode())

    def leave(self) -> None:
        """Close the terminal and wait for the end of the program."""
        self.close()
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGTERM)
        self.wait()


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def fleet(shared_place: Path) -> AsyncIterator[Fleet]:
    async with Crew(REALM, shared_place) as crew:
        arm = await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--open")
        await crew.start_all(
            ("lookup", "lookup-1"),
            ("host", "host-1"),
            ("proxy", "arm", "arm-1", "--connect", arm.address, "--open"),
        )
        async with joined(REALM) as fleet:
            await until(lambda: len(fleet.robots()) == 1, "the arm is listed")
            yield fleet


@pytest.fixture
def operator(fleet: Fleet) -> Iterator[Operator]:
    del fleet  # it is there
    found = Operator()
    try:
        found.shows(b"pose")  # in the details of the arm, which is selected
        yield found
    finally:
        found.leave()


async def test_a_form_that_is_filled_in_in_one_burst_is_run_as_it_was_typed(
    fleet: Fleet, operator: Operator
) -> None:
    operator.types(ENTER, sees="peak")  # the panel has its first readings
    operator.types(
        f"{DOWN}{ENTER}{CTRL_U}0.5{BACKSPACE}4{TAB}{CTRL_U}0.1{TAB}{CTRL_U}35cm{CTRL_R}", sees="done in"
    )
    pose = await fleet.call("arm-1", "get_info", {})
    assert (pose["x"], pose["y"], pose["z"]) == pytest.approx((0.4, 0.1, 0.35), abs=0.01)


async def test_hasty_keys_after_create_make_no_other_robot(fleet: Fleet, operator: Operator) -> None:
    operator.types(":create examples/move_to.py as mover\rn", sees="new virtual robot")
    await until(lambda: any(one.name == "mover" for one in fleet.robots()), "it is made")
    operator.types(f"{TAB}", sees="Create")
    operator.types(f"\x1b[Bznwz{ENTER}e{ENTER}", sees="new virtual robot")
    names = {one.name for one in fleet.robots()}
    assert names <= {"arm-1", "mover"}, "nobody asked for another one"
    await fleet.delete("mover")


async def test_the_stop_works_in_a_field_and_a_question_is_answered_by_its_own_keys(
    fleet: Fleet, operator: Operator
) -> None:
    operator.types(ENTER, sees="peak")  # the panel has its first readings
    operator.types(f"{DOWN}{ENTER}{CTRL_U}0.4 {CTRL_S}", sees="PROTECTIVE STOP")
    assert (await fleet.describe("arm-1")).stopped
    operator.types("\x1b", sees="log  g")
    operator.types("R", sees="Is all clear?")
    operator.types(ENTER, sees="log  g")
    assert (await fleet.describe("arm-1")).stopped, "Enter came upon Cancel"
    operator.types(f"R{RIGHT}{ENTER}", sees="was resumed")
    assert not (await fleet.describe("arm-1")).stopped
