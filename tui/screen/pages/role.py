"""Giving a robot another role."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.widgets import Label, OptionList
from textual.widgets.option_list import Option

from robotree.tui.line.grammar import Line
from robotree.tui.screen.pages.dialogs import Modal


class RoleDialog(Modal[Line | None]):
    """Choose one of the roles that a robot knows."""

    def __init__(self, name: str, roles: Sequence[str], present: str) -> None:
        """Offer these roles; `present` is the one that it plays."""
        super().__init__()
        self._robot, self._roles, self._present = name, list(roles), present

    def box(self) -> ComposeResult:
        """A list."""
        with Vertical(classes="dialog"):
            yield Label(
                f"Which role does {self._robot} play from its next act on?",
                classes="dialog-title",
                markup=False,
            )
            options = [
                Option(Text.assemble((role, "bold"), "  now" if role == self._present else ""), id=role)
                for role in self._roles
            ]
            yield OptionList(*options, markup=False)

    def on_mount(self) -> None:
        """Point at the role that it plays."""
        if self._present in self._roles:
            self.query_one(OptionList).highlighted = self._roles.index(self._present)

    @on(OptionList.OptionSelected)
    def _chosen(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(Line("role", {"NAME": self._robot, "ROLE": event.option.id or ""}))
