"""Having a robot go on in another host."""

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


class HostDialog(Modal[Line | None]):
    """Choose one of the hosts to which a robot can move."""

    def __init__(self, name: str, present: str, hosts: Sequence[str]) -> None:
        """Offer these hosts; `present` is the one where it is."""
        super().__init__()
        self._robot, self._present, self._hosts = name, present, sorted(hosts)

    def box(self) -> ComposeResult:
        """A list."""
        with Vertical(classes="dialog"):
            yield Label(
                f"Where does {self._robot} go on? It is on {self._present}.",
                classes="dialog-title",
                markup=False,
            )
            yield OptionList(*(Option(Text(host, "bold"), id=host) for host in self._hosts), markup=False)

    @on(OptionList.OptionSelected)
    def _chosen(self, event: OptionList.OptionSelected) -> None:
        self.dismiss(Line("migrate", {"NAME": self._robot, "HOST": event.option.id or ""}))
