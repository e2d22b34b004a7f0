"""The rows of a form, by the names of their fields."""

from __future__ import annotations

from textual.widget import Widget

from robotree.tui.screen.widgets.field_row import FieldRow


def row(form: Widget, name: str) -> FieldRow:
    """Return the row of a field in a form, or in a page with one form."""
    return {one.spec.name: one for one in form.query(FieldRow)}[name]
