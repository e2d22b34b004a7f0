"""A text that is drawn again only when it differs, so that a calm screen costs nothing."""

from __future__ import annotations

from rich.text import Text
from textual.content import Content
from textual.events import Resize
from textual.message import Message
from textual.widget import Widget
from textual.widgets import Static

from robotree.tui.screen.part import Part


class CachedText(Part, Static):
    """Shows a text. Pages draw themselves a few times a second; most of it is the same as before."""

    class Resized(Message):
        """It has another width: what was made for the one before may be cut."""

    def __init__(
        self,
        *,
        id: str | None = None,  # noqa: A002 # Textual's name for it
        classes: str | None = None,
    ) -> None:
        """Show nothing; whatever will be shown is no markup."""
        super().__init__("", id=id, classes=classes, markup=False)
        self._shown = Text()
        self._width = 0

    def on_resize(self, event: Resize) -> None:
        """Ask for what fits."""
        if event.size.width != self._width:
            self._width = event.size.width
            self.post_message(self.Resized())

    def show(self, text: Text) -> None:
        """Show a text, unless it is shown already; the page is laid out anew only where that may matter."""
        if text == self._shown:
            return
        moved = self.extent(text) != self.extent(self._shown)
        self._shown = text
        self.update(text, layout=moved)

    def extent(self, text: Text) -> list[int]:
        """Return what of a text decides how much room it takes: the lengths of its lines [characters]."""
        return [len(line) for line in text.plain.split("\n")]


def entitle(widget: Widget, title: str, below: str = "") -> None:
    """Write into the frame of a widget, unless it stands there: Textual draws all of it again for a title."""
    wanted, under = Content(title).markup, Content(below).markup
    if (widget.border_title or "") != wanted:
        widget.border_title = Text(title)
    if (widget.border_subtitle or "") != under:
        widget.border_subtitle = Text(below)
