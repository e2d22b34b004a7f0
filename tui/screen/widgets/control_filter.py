"""Nothing that comes from afar steers the terminal: every line of every widget goes through here.

Rich and Textual take a few control characters out of a text and let escapes pass. What steers has no width,
so it is taken away without moving anything.
"""

from __future__ import annotations

from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

from robotree.tui.terminal import STEERING


class ControlFilter(LineFilter):
    """Takes away what steers a terminal instead of being seen."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:  # noqa: ARG002 # Textual's contract
        """Return the segments of one line with harmless texts; see `LineFilter.apply`."""
        if not any(STEERING.search(segment.text) for segment in segments):
            return segments
        return [Segment(STEERING.sub("", text), style) for text, style, _ in segments]
