"""Creating a virtual robot: choose its file, see what is in it, name it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Button, Input

from robotree.tui.line.grammar import Line
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.new import OWN_HOST, NewPage, SourceTree
from robotree.tui.screen.widgets.field_row import Choice, FieldRow

if TYPE_CHECKING:
    from screens.conftest import Operator
    from tui.conftest import Realm


GOOD = '''
"""A file."""
from robotree.vr import Child, VirtualRobot, command

class Painter(VirtualRobot):
    """Paints [/x]."""
    arm = Child("Arm")
    @command
    def paint(self) -> None:
        """Paint."""

class Finisher(Painter):
    """Finishes."""
'''


SETTINGS = """
from typing import Annotated
from robotree.vr import Range, Unit, VirtualRobot, command

class Team(VirtualRobot):
    speed: Annotated[float, Unit("m/s"), Range(0.01, 0.3)] = 0.1
    turn: Annotated[float, Unit("rad")] = 0.0
    label: str = "left"

    @command
    def told(self) -> str:
        return f"{self.speed:g} {self.turn:.3f} {self.label}"
"""


@pytest.fixture(autouse=True)
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "robots"
    folder.mkdir()
    (folder / "good.py").write_text(GOOD)
    (folder / "empty.py").write_text("x = 1\n")
    (folder / "team.py").write_text(SETTINGS)
    (folder / "wrong.py").write_text("def (:\n")
    (folder / "raises.py").write_text(
        "from robotree.vr import VirtualRobot\nclass R(VirtualRobot): ...\n1 / 0\n"
    )
    (folder / "binary.py").write_bytes(b"\xff\xfe\x00")
    (folder / "notes [red].py").write_text(GOOD)
    (folder / "notes.txt").write_text("no source")
    (folder / "a.panel.py").write_text("# the panel of a page is no robot")
    (folder / ".hidden.py").write_text(GOOD)
    monkeypatch.chdir(folder)
    monkeypatch.setattr("robotree.tui.screen.pages.new.places", lambda: [("this folder", folder)])


async def pick(operator: Operator, name: str) -> NewPage:
    await operator.until(lambda: bool(operator.app.store.hosts), "a host")
    await operator.press("n")
    page = await operator.at(NewPage)
    tree = operator.one(SourceTree)
    await operator.sees("good.py")
    tree.focus()
    await operator.press("home")
    for _ in range(12):
        node = tree.cursor_node
        if node and node.data and node.data.path.name == name:
            break
        await operator.press("down")
    await operator.press("enter")
    await operator.until(lambda: page.path is not None and page.path.name == name, name)
    return page


async def test_a_robot_is_created_from_a_file_and_appears_by_itself(operator: Operator) -> None:
    page = await pick(operator, "good.py")
    await operator.sees("Finishes.", "finisher", "notes [red].py", "wrong.py")
    assert "notes.txt" not in operator.text
    assert ".hidden.py" not in operator.text
    page.query_one("#class", Choice).value = "Painter"
    await operator.sees("Paints [/x].", "slot arm: Arm", "commands paint")
    assert page.query_one("#name", Input).value == "painter"
    page.query_one("#name", Input).focus()
    await operator.press("enter")
    await operator.at(MainPage)
    await operator.sees("painter (Painter) runs on host-1")
    await operator.until(lambda: "painter" in operator.app.store.robots, "it is listed")


async def test_a_file_that_offers_nothing_says_why(operator: Operator) -> None:
    for file, says in (
        ("empty.py", "It defines no virtual robot"),
        ("wrong.py", "It is no Python that can be read: line 1"),
        ("binary.py", "It cannot be read"),
    ):
        page = await pick(operator, file)
        await operator.sees(says)
        assert page.query_one("#create", Button).disabled
        await operator.press("escape")
        await operator.at(MainPage)
    assert set(operator.app.store.robots) == {"arm-1", "rover-1"}


async def test_a_file_that_raises_when_it_is_loaded_keeps_the_page_and_says_why(operator: Operator) -> None:
    page = await pick(operator, "raises.py")
    await operator.until(lambda: not page.query_one("#create", Button).disabled, "it can be tried")
    page.query_one("#create", Button).press()
    await operator.sees("cannot be loaded", "division by zero")
    assert isinstance(operator.app.screen, NewPage)
    assert set(operator.app.store.robots) == {"arm-1", "rover-1"}


async def test_a_name_is_judged_while_it_is_typed_and_a_process_of_its_own_is_asked_for(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = await pick(operator, "good.py")
    entry = page.query_one("#name", Input)
    await operator.until(lambda: entry.value == "finisher", "a suggestion")
    for text, says in (
        ("arm-1", "already running"),
        ("a.b", "cannot be a name"),
        ("[/x]", "cannot be a name"),
    ):
        entry.value = text
        await operator.sees(says)
        assert page.query_one("#create", Button).disabled
    entry.value = "right"
    await operator.until(lambda: not page.query_one("#create", Button).disabled, "it can be created")
    page.query_one("#class", Choice).value = "Painter"
    await operator.sees("Paints")
    assert entry.value == "right", "a name that was typed stays when another class is chosen"
    lines = list[Line]()

    async def attempt(line: Line) -> str:
        lines.append(line)
        return "not now"

    monkeypatch.setattr(operator.app, "attempt", attempt)
    page.query_one("#host", Choice).value = OWN_HOST
    page.query_one("#create", Button).press()
    await operator.sees("✗ not now")
    assert lines[0].flag("--own-host")


async def test_the_settings_of_a_page_are_fields_and_those_that_were_edited_are_given(
    realm: Realm, operator: Operator
) -> None:
    page = await pick(operator, "team.py")
    await operator.sees("settings", "0.01 … 0.3 m/s", "label")
    page.read(Path("good.py"))
    await operator.until(lambda: not page.query(FieldRow), "another class has other settings")
    assert not page.query_one("#settings-caption").display  # the test's own folder has this word, too
    page.read(Path("team.py"))
    await operator.sees("settings", "0.01 … 0.3 m/s", "label")
    rows = {row.spec.name: row for row in page.query(FieldRow)}
    assert [row.text for row in rows.values()] == ["0.1", "0.0", "left"]
    rows["speed"].query_one(Input).value = "7"
    page.query_one("#create", Button).press()
    await operator.sees("7 is out of range")
    assert isinstance(operator.app.screen, NewPage)
    rows["speed"].query_one(Input).value = "20 cm/s"
    rows["turn"].query_one(Input).value = "90"
    page.query_one("#create", Button).press()
    await operator.at(MainPage)
    await operator.until(lambda: "team" in operator.app.store.robots, "it is listed")
    assert await realm.realm_client.call("team", "told", {}) == "0.2 1.571 left"
