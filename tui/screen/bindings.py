"""Textual's bindings, made from the registry."""

from __future__ import annotations

from collections.abc import Mapping

from textual import actions
from textual.binding import Binding, BindingType

from robotree.tui.line.page_keys import KEYS_BY_ID, page_keys
from robotree.tui.line.surface import Surface


def bindings(page: str) -> list[BindingType]:
    """Return the bindings of a page beside the main one."""
    return [
        Binding(
            key.key,
            key.action,
            key.label,
            show=bool(key.label),
            key_display=key.shown or None,
            tooltip=key.help,
            id=key.id,
        )
        for key in page_keys(page)
    ]


_known: dict[type, Mapping[tuple[str, tuple[object, ...]], str]] = {}
"""By page or widget: the verb that each of its keys wants, by its action."""


def _wants(holder: type) -> Mapping[tuple[str, tuple[object, ...]], str]:
    if holder in _known:
        return _known[holder]
    found: dict[tuple[str, tuple[object, ...]], str] = {}
    for binding in getattr(holder, "BINDINGS", ()):
        if isinstance(binding, Binding) and binding.id and binding.id in KEYS_BY_ID:
            _, name, parameters = actions.parse(binding.action)
            found[name, parameters] = KEYS_BY_ID[binding.id].wants
    _known[holder] = found
    return found


def named_keys(holder: object) -> Mapping[str, str]:
    """Return the verb that each key of a page or widget wants, by the key's name in a keymap file."""
    own = (binding.id or "" for binding in getattr(holder, "BINDINGS", ()) if isinstance(binding, Binding))
    return {name: KEYS_BY_ID[name].wants for name in own if name in KEYS_BY_ID}


def refusal(holder: object, surface: Surface, action: str, parameters: tuple[object, ...]) -> str:
    """Return why a key of a page or widget is absent; empty: it is there."""
    verb = _wants(type(holder)).get((action, parameters), "")
    return surface.refusal(verb) if verb else ""
