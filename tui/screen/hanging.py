"""A longer text in a narrow box: what goes on in another line stands below its column. Pure."""

from __future__ import annotations

import re

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

_COLUMNS = re.compile(r"^\s+|(?<=\S)\s{2,}(?=\S)")
"""What stands before a line, or between two columns of a table."""
LEAST = 24
"""Cells that the last column needs; where they are not there, the line begins anew on the left."""


def hanging(text: Text, width: int, console: Console) -> Text:
    """Return a text whose lines have at most `width` cells.

    Args:
        text: lines, some of them rows of a table whose columns are two spaces apart.
        width: [cells]
        console: measures and breaks lines.
    """
    found: list[Text] = []
    for line in text.split("\n", allow_blank=True):
        gaps = list(_COLUMNS.finditer(line.plain))
        start = gaps[-1].end() if gaps else 0
        indent = cell_len(line.plain[:start])
        if line.cell_len <= width or width - indent < LEAST:
            found.append(line)
            continue
        before, column = line.divide([start])
        for number, part in enumerate(column.wrap(console, width - indent)):
            part.rstrip()
            found.append(Text.assemble(" " * indent, part) if number else before + part)
    return Text("\n").join(found)
