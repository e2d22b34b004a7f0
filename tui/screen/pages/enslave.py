"""Putting a robot on top of another one: a slot, and the free robots of the right kind for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Button, Label, OptionList
from textual.widgets.option_list import Option

from robotree.tui.line.grammar import Line
from robotree.tui.screen.pages.dialogs import LOOK, Modal
from robotree.tui.seen import wording

if TYPE_CHECKING:
    from robotree.tui.seen.store import Store


@dataclass(frozen=True, slots=True)
class Opening:
    """An empty slot that can be filled."""

    parent: str
    slot: str
    kind: str
    doc: str = ""
    commands: tuple[str, ...] = ()

    @property
    def path(self) -> str:
        """`PARENT.SLOT`, as the verbs want it."""
        return f"{self.parent}.{self.slot}"


def openings(store: Store, name: str) -> list[Opening]:
    """Return the empty slots that concern a robot.

    Args:
        store: what is known.
        name: a robot. With empty slots of its own: those.
            Without: those of the robots below it, then those of others that take it.
    """
    every = [
        Opening(robot.name, slot.name, slot.kind, slot.doc, slot.commands)
        for robot in sorted(store.descriptions.values(), key=lambda one: one.name)
        for slot in robot.slots
        if not slot.filled
    ]
    own = [one for one in every if one.parent == name]
    kinds = store.robots[name].kinds if name in store.robots else ()
    below = [one for one in every if name in store.lineage(one.parent)]
    others = [one for one in every if one.kind in kinds and one not in below]
    return own or [*below, *others]


NARROW = [(0, "-slim"), (60, "-wide")]
"""[cells] from which on the robots stand beside the slots, not below them."""


class EnslaveDialog(Modal[Line]):
    """Choose a slot, choose a robot for it."""

    HORIZONTAL_BREAKPOINTS = NARROW

    def __init__(self, store: Store, places: Sequence[Opening], child: str = "") -> None:
        """Offer these slots; `child` is the robot that was pointed at."""
        super().__init__()
        self._store, self._openings, self._child = store, list(places), child
        self._offered: tuple[Opening, list[str]] | None = None
        """The slot for which robots are offered, and their names."""

    def box(self) -> ComposeResult:
        """Slots on the left, robots on the right."""
        slots = (
            Option(Text.assemble((opening.path, "bold"), f"  takes {opening.kind}"))
            for opening in self._openings
        )
        with Vertical(classes="dialog enslave"):
            yield Label("Enslave", classes="dialog-title", markup=False)
            with Horizontal(classes="choices"):
                yield OptionList(*slots, id="slots", markup=False)
                yield OptionList(id="children", markup=False)
            yield Label("", id="enslave-note", markup=False)
            with Horizontal(classes="buttons"):
                yield Button("Cancel", id="no", compact=True)
                yield Button("Enslave", id="yes", variant="primary", compact=True)

    def on_mount(self) -> None:
        """Offer the children of the first slot."""
        slots, children = self.query_one("#slots", OptionList), self.query_one("#children", OptionList)
        slots.border_title, children.border_title = "slot", "robot"
        slots.highlighted = 0
        (children if len(self._openings) == 1 else slots).focus()
        self.set_interval(LOOK, self.guarded(self._offer))

    @property
    def _opening(self) -> Opening:
        highlighted = self.query_one("#slots", OptionList).highlighted
        return self._openings[highlighted or 0]

    @on(OptionList.OptionHighlighted, "#slots")
    def _offer(self) -> None:
        """Offer the robots that the slot takes now; the one that was pointed at stays."""
        opening = self._opening
        children = self.query_one("#children", OptionList)
        found = self._store.candidates(opening.parent, opening.kind, opening.commands)
        names = [one.name for one in found]
        if self._offered == (opening, names):
            return
        before, at = self._offered, children.highlighted_option
        self._offered = opening, names
        children.clear_options()
        for listing in found:
            about = wording.summary(listing.doc)
            children.add_option(
                Option(
                    Text.assemble(
                        (listing.name, "bold"), f"  {wording.kind(listing.kind, listing.attributes)}  {about}"
                    ),
                    id=listing.name,
                )
            )
        if before and before[0] == opening and at:  # the list has changed by itself
            children.highlighted = names.index(at.id) if at.id in names else None
        elif names:
            children.highlighted = names.index(self._child) if self._child in names else 0
        self.query_one("#enslave-note", Label).update(opening.doc if names else self._why_none(opening))
        self.query_one("#yes", Button).disabled = not names

    def _why_none(self, opening: Opening) -> str:
        others = [candidate.name for candidate in self._store.candidates(opening.parent, opening.kind)]
        if others:
            return (
                f"{', '.join(others)}: not all of {', '.join(opening.commands)}, which {opening.path} needs"
            )
        return f"no free {opening.kind} is listed: start or release one first"

    @on(OptionList.OptionSelected, "#slots")
    def _on_to_children(self) -> None:
        self.query_one("#children", OptionList).focus()

    @on(OptionList.OptionSelected, "#children")
    @on(Button.Pressed, "#yes")
    def _choose(self) -> None:
        opening, chosen = self._opening, self.query_one("#children", OptionList).highlighted_option
        if self._offered is None or self._offered[0] != opening:
            self._offer()  # what was seen were robots for another slot
        elif chosen and chosen.id:
            self.dismiss(Line("enslave", {"PARENT.SLOT": opening.path, "CHILD": (chosen.id,)}))
        else:
            self.query_one("#enslave-note", Label).update("choose a robot: ↑ ↓")
