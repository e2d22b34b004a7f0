"""The keys of the page at the bottom, as many as there is room for; help is always among them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.cells import cell_len
from textual.app import ComposeResult
from textual.events import Resize
from textual.screen import Screen
from textual.widget import Widget
from textual.widgets import Footer, Input, TextArea
from textual.widgets._footer import FooterKey

from robotree.tui.line.action import spell
from robotree.tui.line.actions import BY_VERB
from robotree.tui.screen.keymap import default_keys
from robotree.tui.screen.part import Part
from robotree.tui.words import say

HELP = BY_VERB["help"]
GAPS = 2
"""Columns beside the letters of a key: one before its word, one behind it."""


class KeyLine(Part, Footer):
    """A footer in which no word is cut: what has no room is left out, from the right, and help never."""

    def __init__(self) -> None:
        """Show the keys in as few columns as possible."""
        super().__init__(show_command_palette=False, compact=True)
        self._width = 0

    def compose(self) -> ComposeResult:
        """Yield the keys that have room."""
        keys = self._as_listed(super().compose())
        for key in keys:
            if isinstance(key, FooterKey):
                key.description = say(key.description)
        if keys and not any(map(_is_help, keys)):
            keys.append(self._help())
        widths = [_width(key) for key in keys]
        last = next((place for place, key in enumerate(keys) if _is_help(key)), None)
        kept = [keys[place] for place in fitting(widths, self.screen.size.width, last)]
        for key in kept:
            key.set_class(True, "-compact", update=False)  # set when it is mounted, it would be styled twice
        self.styles.grid_size_columns = len(kept)
        yield from kept

    async def recompose(self) -> None:
        """Put new keys in place of the old ones if any of them differs: most changes are of hidden keys."""
        if self.is_attached and [*map(_appearance, self.compose())] != [*map(_appearance, self.children)]:
            await super().recompose()

    def _as_listed(self, keys: Iterable[Widget]) -> list[Widget]:
        """Return keys in the order of the registry, those of each widget together.

        Textual (8.2.8, `BindingsMap.apply_keymap`) puts a key that the operator changed behind all others.
        """
        order, active = list(default_keys()), self.screen.active_bindings
        nodes = list(dict.fromkeys(id(one.node) for one in active.values()))

        def place(key: Widget) -> tuple[int, int]:
            bound = active.get(key.key) if isinstance(key, FooterKey) else None
            if bound is None:
                return len(nodes), 0
            name = bound.binding.id or ""
            return nodes.index(id(bound.node)), order.index(name) if name in order else -1

        return sorted(keys, key=place)

    def bindings_changed(self, screen: Screen[object]) -> None:
        """Draw the keys again, also in a terminal that has no focus, such as a detached one of tmux."""
        super().bindings_changed(screen)  # pyright: ignore[reportUnknownMemberType] # Textual leaves it open
        if not self.app.app_focus and self.is_attached and screen is self.screen:
            self.call_after_refresh(self.recompose)

    def _help(self) -> FooterKey:
        """Return the key of the help where a question is in front, or somebody types."""
        typing = isinstance(self.screen.focused, Input | TextArea)
        key = HELP.typing_key if typing else HELP.key
        return FooterKey(key, spell(key), say(HELP.label), "app.verb('help')").data_bind(
            compact=Footer.compact
        )

    def on_resize(self, event: Resize) -> None:
        """Choose anew where there is more room, or less."""
        if event.size.width != self._width:
            self._width = event.size.width
            self.refresh(recompose=True)


def fitting(widths: Sequence[int], room: int, needed: int | None) -> list[int]:
    """Return the places of what fits into a line, the first ones first; the needed one is always among them.

    Args:
        widths: of each, in columns.
        room: of the line.
        needed: place of what must not be left out; None: there is none.
    """
    left = room - (widths[needed] if needed is not None else 0)
    kept: list[int] = []
    for place, width in enumerate(widths):
        if place == needed:
            kept.append(place)
        elif width <= left:
            left -= width
            kept.append(place)
        else:
            left = 0  # what comes later matters less than what was left out
    return kept


def _appearance(key: Widget) -> tuple[object, ...]:
    """Return all that an operator sees of a key, and what it does."""
    if not isinstance(key, FooterKey):
        return (key,)
    return key.key, key.key_display, key.description, key.action, key.has_class("-disabled"), key.tooltip


def _is_help(key: Widget) -> bool:
    return isinstance(key, FooterKey) and key.description == say(HELP.label)


def _width(key: Widget) -> int:
    return cell_len(key.key_display) + cell_len(key.description) + GAPS if isinstance(key, FooterKey) else 0
