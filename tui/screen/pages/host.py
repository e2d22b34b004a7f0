"""Having a robot go on in another host, and saying who decides that."""

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
from robotree.vr.base.description import RobotDescription

CHOICES = {
    "manual": "people alone move it",
    "advise": "it says where it would be better off",
    "auto": "it moves there by itself",
}
"""Who decides where a robot is, for people."""


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


class PlacementDialog(Modal[Line | None]):
    """Shows what is advised of the place of a robot; carries that out, or says who decides from now on."""

    def __init__(self, robot: RobotDescription, advised: str) -> None:
        """Show this robot; `advised` is the host on which it would be better off, empty: on none."""
        super().__init__()
        self._shown, self._advised = robot, advised

    def box(self) -> ComposeResult:
        """The advice, and a list."""
        robot = self._shown
        advice = robot.advice or (
            "nobody has looked yet: choose advise" if robot.placement == "manual" else "nobody has looked yet"
        )
        with Vertical(classes="dialog"):
            yield Label(f"{robot.name} is on {robot.host}", classes="dialog-title", markup=False)
            yield Label(advice, markup=False, classes="dialog-text")
            yield OptionList(*self._options(), markup=False)

    def _options(self) -> list[Option]:
        options = [
            Option(
                Text.assemble((word, "bold"), f"  {what}", " (now)" * (word == self._shown.placement)),
                id=word,
            )
            for word, what in CHOICES.items()
        ]
        if self._advised:
            options.insert(0, Option(Text(f"move to {self._advised} now", "bold"), id="migrate"))
        return options

    @on(OptionList.OptionSelected)
    def _chosen(self, event: OptionList.OptionSelected) -> None:
        name, chosen = self._shown.name, event.option.id or ""
        if chosen == "migrate":
            self.dismiss(Line("migrate", {"NAME": name, "HOST": self._advised}))
        else:
            self.dismiss(Line("place", {"NAME": name, "PLACEMENT": chosen}))
