"""A screen as SVG that looks the same in a browser and in a plain SVG rasteriser.

Each word stands at its own place, so that words cannot run together whatever font is there; spaces are not
written at all. Half blocks, which pictures are made of, become one embedded image. Nothing is fetched from
elsewhere.
"""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Sequence
from html import escape

from PIL import Image
from rich.color import Color, ColorSystem
from rich.segment import Segment
from rich.style import Style
from rich.terminal_theme import TerminalTheme
from textual.strip import Strip

CELL, LINE = 9, 19
"""[px] width and height of a character cell."""
SIZE, BASE = 15, 14
"""[px] size of the letters, and where they stand in their line."""
EDGE, TITLE = 10, 30
"""[px] around the screen, and of the title above it."""
FONTS = "'DejaVu Sans Mono', 'Noto Sans Mono', Menlo, Consolas, 'Liberation Mono', monospace"
THEME = TerminalTheme((20, 23, 29), (216, 219, 226), [(0, 0, 0)] * 8, [(128, 128, 128)] * 8)
"""For what has no colour of its own."""
XTERM = TerminalTheme(
    (0, 0, 0),
    (229, 229, 229),
    [(0, 0, 0), (205, 0, 0), (0, 205, 0), (205, 205, 0), (0, 0, 238), (205, 0, 205), (0, 205, 205),
     (229, 229, 229)],
    [(127, 127, 127), (255, 0, 0), (0, 255, 0), (255, 255, 0), (92, 92, 255), (255, 0, 255), (0, 255, 255),
     (255, 255, 255)],
)  # fmt: skip
"""The 16 colours of xterm."""
HALF = "▀"
WORD = re.compile(r"\S+")

Cell = tuple[str, Style]


def svg(strips: Sequence[Strip], title: str, *, colours: int = 0) -> str:
    """Return a screen as an SVG document.

    Args:
        strips: its lines.
        title: above it.
        colours: 256 or 16 to show it as a terminal with so many colours does; 0: true colours.
    """
    rows = [_cells(strip, colours) for strip in strips]
    width = max(sum(len_of(text) for text, _ in row) for row in rows)
    parts = [_frame(width, len(rows), title)]
    for line, row in enumerate(rows):
        parts += _line(row, line)
    parts += _pictures(rows)
    return "\n".join([*parts, "</g>", "</svg>", ""])


def len_of(text: str) -> int:
    """Return how many cells a text takes."""
    return Segment(text).cell_length


def _cells(strip: Strip, colours: int) -> list[Cell]:
    """Return the runs of a line, in the colours that are to be seen."""
    runs: list[Cell] = []
    for text, style, control in strip:
        if control or not text:
            continue
        runs.append((text, _seen(style or Style(), colours)))
    return runs


def _seen(style: Style, colours: int) -> Style:
    front, back = _rgb(style.color, colours, foreground=True), _rgb(style.bgcolor, colours, foreground=False)
    if style.reverse:
        front, back = back, front
    return Style(color=front, bgcolor=back, bold=style.bold, italic=style.italic, underline=style.underline,
                 strike=style.strike, dim=style.dim)  # fmt: skip


def _rgb(colour: Color | None, colours: int, *, foreground: bool) -> Color:
    if colour is None or colour.is_default:
        red, green, blue = THEME.foreground_color if foreground else THEME.background_color
        return Color.from_rgb(red, green, blue)
    if colours:
        colour = colour.downgrade(ColorSystem.STANDARD if colours == 16 else ColorSystem.EIGHT_BIT)
    triplet = colour.get_truecolor(XTERM)
    return Color.from_triplet(triplet)


def _hex(colour: Color | None) -> str:
    return colour.get_truecolor().hex if colour else "#000000"


def _frame(width: int, height: int, title: str) -> str:
    wide, high = width * CELL + 2 * EDGE, height * LINE + EDGE + TITLE
    back = "#{:02x}{:02x}{:02x}".format(*THEME.background_color)
    dots = "".join(
        f'<circle cx="{EDGE + 8 + 18 * place}" cy="{TITLE // 2}" r="5" fill="{colour}"/>'
        for place, colour in enumerate(("#e46876", "#e6c384", "#98bb6c"))
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}"'
        f' width="{wide}" height="{high}">\n'
        f"<title>{escape(title)}</title>\n"
        f"<style>text {{ font: {SIZE}px {FONTS}; }} .b {{ font-weight: bold; }} .i {{ font-style: italic; }}"
        " .u { text-decoration: underline; } .s { text-decoration: line-through; } .d { opacity: 0.6; }"
        " rect { shape-rendering: crispEdges; }</style>\n"
        f'<rect width="{wide}" height="{high}" rx="8" fill="{back}" stroke="#3a4250"/>\n{dots}\n'
        f'<text x="{wide / 2}" y="{TITLE // 2 + 5}" text-anchor="middle" fill="#8a93a3">'
        f"{escape(title)}</text>\n"
        f'<g transform="translate({EDGE} {TITLE})">'
    )


def _line(row: Iterable[Cell], line: int) -> list[str]:
    """Return backgrounds, then words, of one line."""
    backs: list[tuple[int, int, str]] = []
    words: list[str] = []
    column, top = 0, line * LINE
    for text, style in row:
        width = len_of(text)
        back = _hex(style.bgcolor)
        if backs and backs[-1][2] == back:
            backs[-1] = (backs[-1][0], backs[-1][1] + width, back)
        else:
            backs.append((column, width, back))
        for found in WORD.finditer(text):
            if set(found[0]) == {HALF}:
                continue
            start = column + len_of(text[: found.start()])
            words.append(_word(found[0], start, top, style))
        column += width
    rects = [
        f'<rect x="{start * CELL}" y="{top}" width="{width * CELL}" height="{LINE}" fill="{back}"/>'
        for start, width, back in backs
    ]
    return [*rects, *words]


def _word(word: str, column: int, top: int, style: Style) -> str:
    marks = "".join(
        mark
        for mark, given in zip("biusd", (style.bold, style.italic, style.underline, style.strike, style.dim),
                               strict=True)
        if given
    )  # fmt: skip
    known = f' class="{" ".join(marks)}"' if marks else ""
    length = f' textLength="{len_of(word) * CELL}"'
    return (
        f'<text x="{column * CELL}" y="{top + BASE}" fill="{_hex(style.color)}"{known}{length}>'
        f"{escape(word)}</text>"
    )


def _pictures(rows: Sequence[Sequence[Cell]]) -> list[str]:
    """Return each block of half blocks as one image."""
    places: dict[tuple[int, int], tuple[tuple[int, ...], tuple[int, ...]]] = {}
    for line, row in enumerate(rows):
        column = 0
        for text, style in row:
            for letter in text:
                if letter == HALF and style.color and style.bgcolor:
                    places[line, column] = (style.color.get_truecolor(), style.bgcolor.get_truecolor())
                column += len_of(letter)
    return [_image(block, places) for block in _blocks(set(places))]


def _blocks(left: set[tuple[int, int]]) -> list[tuple[int, int, int, int]]:
    """Return the rectangles (line, column, height, width) that cover all places, each once."""
    found: list[tuple[int, int, int, int]] = []
    while left:
        line, column = min(left)
        width = 1
        while (line, column + width) in left:
            width += 1
        height = 1
        while all((line + height, one) in left for one in range(column, column + width)):
            height += 1
        left -= {(line + down, column + right) for down in range(height) for right in range(width)}
        found.append((line, column, height, width))
    return found


def _image(
    block: tuple[int, int, int, int],
    places: dict[tuple[int, int], tuple[tuple[int, ...], tuple[int, ...]]],
) -> str:
    line, column, height, width = block
    picture = Image.new("RGB", (width, 2 * height))
    for down in range(height):
        for right in range(width):
            upper, lower = places[line + down, column + right]
            picture.putpixel((right, 2 * down), upper)
            picture.putpixel((right, 2 * down + 1), lower)
    file = io.BytesIO()
    # enlarged: a viewer that smooths what it enlarges would smear the pixels
    large = picture.resize((width * CELL, height * LINE), Image.Resampling.NEAREST)
    large.quantize(256).save(file, "PNG", optimize=True)
    data = base64.b64encode(file.getvalue()).decode()
    return (
        f'<image x="{column * CELL}" y="{line * LINE}" width="{width * CELL}" height="{height * LINE}"'
        f' href="data:image/png;base64,{data}"/>'
    )
