"""Textual's bindings, made from the registry."""

from __future__ import annotations

from textual.binding import Binding, BindingType

from robotree.tui.line.page_keys import page_keys


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
