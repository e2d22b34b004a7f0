"""Writing a script: a text of when and then, checked as one types, and made a robot of its own."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Button, Input, Static, TextArea

from robotree.files import text as read_text
from robotree.tui.errors import SupervisorError
from robotree.tui.line.carrying import Refusal, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.known_kinds import checked_script
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.widgets.flash import FlashLine
from robotree.tui.screen.widgets.key_line import KeyLine
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen.behaviours import Behaviour
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robotree.vr.base.description import FieldSpec

LARGEST = 200_000
"""[bytes] of a script."""
FIRST = "mine"
"""Name of the script, until the person writes another one."""


class WritePage(Page):
    """A name, the text, and what is wrong with it."""

    KEYS_OF = "writing"

    def __init__(self, found: Sequence[Behaviour]) -> None:
        """Begin with a script that does the first of these behaviours once."""
        super().__init__()
        self._found = [one for one in found if not (one.leads or one.told)]

    def compose(self) -> ComposeResult:
        """Name, text, buttons, what is wrong."""
        with Horizontal(id="naming"):
            yield Static("name ", classes="field-name", markup=False)
            yield Input(FIRST, compact=True, id="script-name", classes="entry")
        yield TextArea(template(FIRST, self._found), id="script", compact=True)
        yield Static("", id="outcome", markup=False)
        with Horizontal(classes="buttons"):
            yield Button("Check", id="check", compact=True)
            yield Button("Make it", id="make", variant="primary", compact=True)
        yield FlashLine(classes="flash")
        yield KeyLine()

    def on_mount(self) -> None:
        """Begin in the text."""
        self.query_one(TextArea).focus()

    def draw(self) -> None:
        """Draw what happened last."""
        self.query_one(FlashLine).draw(self.app.store, self.app.now())

    @property
    def _named(self) -> str:
        return self.query_one("#script-name", Input).value.strip()

    @on(Input.Changed, "#script-name")
    def _renamed(self) -> None:
        """Have the text say the name, where it says one in its first line."""
        area = self.query_one(TextArea)
        first = area.document.get_line(0)
        if first.startswith("script:") and self._named:
            area.replace(f"script: {self._named}", (0, 0), (0, len(first)))

    @on(Button.Pressed, "#check")
    @work(exclusive=True, exit_on_error=False, group="script")
    async def _check(self) -> None:
        await self._good()

    async def _good(self) -> bool:
        """Say whether the text is a script; returns whether it is."""
        source, name = self.query_one(TextArea).text, self._named
        try:
            rules = await asyncio.to_thread(checked_script, source, f"{name}.yaml")
        except (VrError, SupervisorError, ImportError) as error:
            self._say(f"✗ {error}", "error")
            return False
        self._say(f"✓ good: {rules} rule{'s' * (rules != 1)}", "success")
        return True

    @on(Button.Pressed, "#make")
    @work(exclusive=True, exit_on_error=False, group="script")
    async def action_make(self) -> None:
        """Check, keep and make it."""
        if not await self._good():
            return
        path = Path(f"{self._named}.yaml")
        source = self.query_one(TextArea).text
        try:
            await asyncio.to_thread(keep, path, source)
        except (OSError, FileExistsError) as error:
            self._say(f"✗ {error}", "error")
            return
        made = await carry_out(
            self.app.realm_client, Line("create", {"FILE": str(path), "NAME": self._named}), self.app
        )
        self.app.feed.hint()
        if isinstance(made, Refusal):
            self._say(f"✗ {made}", "error")
            return
        self.app.tell(f"{self._named} is made, and kept in {path}: it stands in the list", "good")
        self.dismiss()

    def _say(self, text: str, colour: str) -> None:
        self.query_one("#outcome", Static).update(Text(text, tint(self.app, colour)))


def keep(path: Path, source: str) -> None:
    """Write a script into a file; one that is another script is not replaced.

    Raises:
        FileExistsError: there is another file of this name.
        OSError: it cannot be written.
    """
    from robotree.files import overwrite

    if path.exists() and read_text(path, LARGEST) != source:
        raise FileExistsError(f"there is another {path} in this folder; give the script another name")
    overwrite(path, source.encode())


def template(name: str, found: Sequence[Behaviour]) -> str:
    """Return a script that has a robot do the first behaviour once, and ends then."""
    one = found[0] if found else None
    kind, command = (one.robot.kind, one.spec.name) if one else ("Arm", "hold")
    needed = [field for field in one.spec.parameters if field.required] if one else []
    given = ", ".join(f"{field.name}: {_example(field)}" for field in needed)
    others = "".join(f"  #   {each.spec.name}: {each.title}\n" for each in found[1:6])
    return (
        f"script: {name}\ndoc: What it is for.\n\npartners:\n"
        f"  robot: {{kind: {kind}, needs: [{command}], choose: free}}\n\nrules:\n"
        f"  - rule: begin\n    when:\n      - start\n    then:\n      - do: robot.{command}\n"
        + (f"        with: {{{given}}}\n" if given else "")
        + f"\n  - rule: finish\n    when:\n      - done: {{partner: robot, act: {command}}}\n"
        f"    then:\n      - end: it is done\n" + (f"  # other acts:\n{others}" if others else "")
    )


def _example(field: FieldSpec) -> str:
    """Return a value that a field takes."""
    if field.choices:
        return field.choices[0]
    if field.type == "str":
        return "text"
    if field.type == "bool":
        return "no"
    low = field.lower if field.lower is not None else 0
    high = field.upper if field.upper is not None else low + 1
    return "0" if low <= 0 <= high else f"{low:g}"
