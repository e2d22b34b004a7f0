"""Textual's bindings, made from the registry."""

from __future__ import annotations

from textual.binding import Binding, BindingType

from robotree.tui.line.page_keys import page_keys


def bindings(page: str) -> list[BindingType]:
    """Return the bindings of a page beside the main one."""
    return [
        Binding(
            one.key,
            one.action,
            one.label,
            show=bool(one.label),
            key_display=one.shown or None,
            tooltip=one.help,
            id=one.id,
        )
        for one in page_keys(page)
    ]
