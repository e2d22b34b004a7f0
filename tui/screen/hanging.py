"""A longer text in a narrow box: continued lines stand below their column; a search drops lines. Pure."""

from __future__ import annotations

import re

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

_COLUMNS = re.compile(r"^\s+|(?<=\S)\s{2,}(?=\S)")
"""The space before a line, or between two columns of a table."""
LEAST = 24
"""Cells that the last column needs; where they are not there, the line begins anew on the left."""
TIE = "\ue000"
"""A space at which no line ends: a figure stays with its name and its unit."""
_UNIT = re.compile(r"(?<=\d) (?=[^\W\d][^\s,;]{0,4}(?:[\s,;]|$))|(?<=\bline) (?=\d)")
"""The space between a figure and its unit, `0.9 s`, `35 N/mm`, and before the number of a line."""


def broken(words: Text, room: int, console: Console) -> list[Text]:
    """Return words in lines of at most `room` cells, as far as their ties allow; ties become spaces.

    Between a figure and its unit there is one, whether it was written or not.
    """
    tied = words.copy()
    tied.plain = _UNIT.sub(TIE, tied.plain)
    lines = list(tied.wrap(console, room))
    for line in lines:
        line.rstrip()
        line.plain = line.plain.replace(TIE, " ")
    return lines


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
        for number, part in enumerate(broken(column, width - indent, console)):
            found.append(Text.assemble(" " * indent, part) if number else before + part)
    return Text("\n").join(found)


def containing(text: Text, letters: str) -> Text:
    """Return the lines that contain these letters, each with what stands indented below and above it.

    Args:
        text: lines; what is indented deeper belongs to the line above it.
        letters: of which the case does not count.
    """
    lines, wanted = list(text.split("\n", allow_blank=True)), letters.strip().casefold()
    depths = [len(line.plain) - len(line.plain.lstrip()) for line in lines]
    kept: set[int] = set()
    for number, line in enumerate(lines):
        if wanted not in line.plain.casefold() or not line.plain.strip():
            continue
        kept |= {number, *_above(depths, lines, number), *_below(depths, number)}
    return Text("\n").join(lines[number] for number in sorted(kept))


def _above(depths: list[int], lines: list[Text], number: int) -> list[int]:
    """Return the nearest lines above that are indented less and less: the titles of a line."""
    found, depth = list[int](), depths[number]
    for above in range(number - 1, -1, -1):
        if depths[above] < depth and lines[above].plain.strip():
            found.append(above)
            depth = depths[above]
    return found


def _below(depths: list[int], number: int) -> list[int]:
    """Return the lines right below that are indented deeper than this one, if it is indented itself."""
    found = list[int]()
    for below in range(number + 1, len(depths)):
        if not depths[number] or depths[below] <= depths[number]:
            break
        found.append(below)
    return found
