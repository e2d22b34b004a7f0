"""Who commands whom, with what each one does now."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.widgets import Tree
from textual.widgets.tree import TreeNode

from robotree.tui.screen.fence import Fenced
from robotree.tui.screen.widgets.marks import mood_mark, tint
from robotree.tui.seen.forest import Branch
from robotree.tui.seen.mood import CALM
from robotree.tui.seen.store import Store


@dataclass(frozen=True, slots=True)
class Place:
    """A node: a robot, or a slot of its parent that is empty."""

    name: str
    """The robot in this place; empty: nobody."""
    parent: str = ""
    slot: str = ""
    kind: str = ""
    """What the slot takes."""
    lost: str = ""


NOWHERE = Place("")
"""Nothing is selected."""


class RobotTree(Fenced, Tree[Place]):
    """Trees with the free robots as roots; everything is open, for there is nothing to hide."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "select_cursor", "Panel")]

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Make an empty tree."""
        super().__init__("robots", id=id)
        self.show_root = False
        self.guide_depth = 3
        self._outline: tuple[object, ...] = ()

    @property
    def selected(self) -> Place:
        """The place under the cursor."""
        node = self.cursor_node
        return node.data if node and node.data else NOWHERE

    def draw(self, roots: Iterable[Branch], store: Store, now: float) -> None:
        """Draw the trees; nodes stay where they are as long as nobody came or went."""
        planted = tuple(roots)
        outline = tuple(_outline(root) for root in planted)
        if outline != self._outline:
            self._outline = outline
            self._plant(planted)
        self._relabel(self.root, store, now)

    def _plant(self, roots: Iterable[Branch]) -> None:
        keep = self.selected
        self.clear()
        for root in roots:
            self._grow(self.root, root, "")
        self.root.expand_all()
        for node in self._below(self.root):
            if node.data and (node.data.name, node.data.slot) == (keep.name, keep.slot):
                self.call_after_refresh(self.move_cursor, node)
                return
        first = next(iter(self.root.children), None)
        if first:
            self.call_after_refresh(self.move_cursor, first)

    def _grow(self, above: TreeNode[Place], branch: Branch, parent: str) -> None:
        slot = branch.slot
        place = Place(
            branch.name,
            parent,
            slot.name if slot else "",
            slot.kind if slot else "",
            slot.lost if slot else "",
        )
        node = above.add(Text(branch.name), place, expand=True, allow_expand=False)
        for one in branch.branches:
            self._grow(node, one, branch.name)

    def _below(self, node: TreeNode[Place]) -> Iterable[TreeNode[Place]]:
        for child in node.children:
            yield child
            yield from self._below(child)

    def _relabel(self, root: TreeNode[Place], store: Store, now: float) -> None:
        for node in self._below(root):
            if node.data:
                label = self._label(node.data, store, now)
                if node.label != label:
                    node.set_label(label)

    def _label(self, place: Place, store: Store, now: float) -> Text:
        muted = tint(self.app, "muted")
        role = Text(f"{place.slot}: ", muted) if place.slot else Text()
        if not place.name:
            lost = f" — {place.lost}" if place.lost else ""
            return Text.assemble(
                role, ("empty", tint(self.app, "warning")), (f"  takes {place.kind}{lost}", muted)
            )
        robot = store.descriptions.get(place.name)
        kind = Text(f"  {robot.kind}" if robot else "  does not answer", muted)
        mood, doing = store.mood(place.name, now), store.doing(place.name, now)
        words = "" if mood in CALM else doing
        mark = mood_mark(self.app, mood, "")
        tail = Text(f"  {words}", mood_mark(self.app, mood, words).spans[-1].style) if words else Text()
        return Text.assemble(mark, role, (place.name, "bold"), kind, tail)


def _outline(branch: Branch) -> tuple[object, ...]:
    slot = branch.slot
    inner = tuple(_outline(one) for one in branch.branches)
    return (branch.name, slot.name if slot else "", slot.lost if slot else "", inner)
