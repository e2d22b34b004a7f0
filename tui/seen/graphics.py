"""Pictures in pixels, for terminals that can: kitty's graphics protocol and sixel. Pure.

What a terminal can is read from its environment, never asked: an answer that comes late would be typed into a
form, one that does not come would hold the start up, and a multiplexer passes neither on reliably. Inside
tmux the server is asked, as a program (`ask_tmux`), which writes nothing into the terminal. A person may say
it better: $ROBOTREE_PICTURES is `kitty`, `sixel` or `cells`.

kitty: https://sw.kovidgoyal.net/kitty/graphics-protocol/ (unicode placeholders: a cell shows its part of a
picture, so that dialogs, scrolling and multiplexers treat it as text). sixel: DEC, "VT330/VT340 Programmer
Reference Manual, volume 2", chapter 14.
"""

from __future__ import annotations

import base64
import io
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, cast, get_args

from PIL import Image, ImageDraw

Graphics = Literal["kitty", "sixel", "cells"]

VARIABLE = "ROBOTREE_PICTURES"
"""Environment variable by which a person says it."""
KITTY_TERMS = ("xterm-kitty", "xterm-ghostty")
"""$TERM of terminals that know placeholders."""
SIXEL_TERMS = ("foot", "mlterm", "contour", "yaft")
"""Beginnings of $TERM of terminals that draw sixels."""
SIXEL_PROGRAMS = {"WezTerm", "iTerm.app", "mintty", "rlogin"}
"""$TERM_PROGRAM of others that do."""
ASK_TMUX = ("#{client_termname}", "#{client_termfeatures}", "#{allow-passthrough}")
"""What is asked of tmux: the terminal that it runs in, what it does with sixels, and what it lets through."""

PLACEHOLDER = "\U0010eeee"
CHUNK = 4096
"""[bytes] of base64 in one escape sequence of kitty."""
COLOURS = 64
"""Of a sixel picture: of a thing from a camera more are not seen, and each costs."""
_ROWS = (
    "0305 030D 030E 0310 0312 033D 033E 033F 0346 034A 034B 034C 0350 0351 0352 0357 035B 0363 0364 0365 "
    "0366 0367 0368 0369 036A 036B 036C 036D 036E 036F 0483 0484 0485 0486 0487 0592 0593 0594 0595 0597 "
    "0598 0599 059C 059D 059E 059F 05A0 05A1 05A8 05A9 05AB 05AC 05AF 05C4 0610 0611 0612 0613 0614 0615 "
    "0616 0617 0657 0658 0659 065A 065B 065D 065E 06D6 06D7 06D8 06D9 06DA 06DB 06DC 06DF 06E0 06E1 06E2 "
    "06E4 06E7 06E8 06EB 06EC 0730 0732 0733 0735 0736 073A 073D 073F 0740 0741 0743 0745 0747 0749 074A "
    "07EB 07EC 07ED 07EE 07EF 07F0 07F1 07F3 0816 0817 0818 0819 081B 081C 081D 081E 081F 0820 0821 0822 "
    "0823 0825 0826 0827 0829 082A "
)
DIACRITICS = tuple(chr(int(number, 16)) for number in _ROWS.split())
"""Numbers of rows and columns, from 0 on, as kitty writes them (its `rowcolumn-diacritics.txt`)."""


def ability(environment: Mapping[str, str], ask_tmux: Callable[[str], str] = lambda _: "") -> Graphics:
    """Return how pictures are drawn in a terminal.

    Args:
        environment: of the program.
        ask_tmux: returns what tmux says of a format; empty: it does not say.
    """
    wanted = environment.get(VARIABLE, "")
    if wanted in get_args(Graphics):
        return cast("Graphics", wanted)
    if environment.get("NO_COLOR") or environment.get("STY"):  # screen passes nothing on
        return "cells"
    if environment.get("TMUX"):
        return _through_tmux(*map(ask_tmux, ASK_TMUX))
    term, program = environment.get("TERM", ""), environment.get("TERM_PROGRAM", "")
    if term in KITTY_TERMS or program == "ghostty":
        return "kitty"
    if program in SIXEL_PROGRAMS or term.startswith(SIXEL_TERMS):
        return "sixel"
    return "cells"


def _through_tmux(term: str, features: str, passthrough: str) -> Graphics:
    if term in KITTY_TERMS and passthrough in {"on", "all", "1"}:
        return "kitty"
    return "sixel" if "sixel" in features.split(",") else "cells"


def wrapped(sequence: str, *, tmux: bool) -> str:
    """Return an escape sequence so that tmux passes it on to its terminal."""
    if not tmux:
        return sequence
    inner = sequence.replace("\x1b", "\x1b\x1b")
    return f"\x1bPtmux;{inner}\x1b\\"


# -- kitty -----------------------------------------------------------------------------------------


def kitty(jpeg: bytes, number: int, columns: int, rows: int, *, tmux: bool = False) -> str:
    """Return what hands a picture over to kitty, to be shown where placeholders of its number stand.

    Nothing is answered (`q=2`), and the cursor does not move.

    Args:
        jpeg: the picture.
        number: of the picture, 1 to 2**24 - 1; one that was sent before is replaced.
        columns: which it fills [cells].
        rows: which it fills [cells].
        tmux: whether tmux is in between.

    Raises:
        OSError: it is no picture.
    """
    with Image.open(io.BytesIO(jpeg)) as picture:
        pixels = picture.convert("RGB")
    width, height = pixels.size
    data = base64.b64encode(zlib.compress(pixels.tobytes(), 1)).decode()
    pieces = [data[at : at + CHUNK] for at in range(0, len(data), CHUNK)]
    head = f"a=T,U=1,q=2,f=24,o=z,s={width},v={height},i={number},c={columns},r={rows}"
    keys = [f"{head},m={int(len(pieces) > 1)}", *["q=2,m=1"] * (len(pieces) - 2), "q=2,m=0"][: len(pieces)]
    sent = (f"\x1b_G{key};{piece}\x1b\\" for key, piece in zip(keys, pieces, strict=True))
    return "".join(wrapped(each, tmux=tmux) for each in sent)


def kitty_forget(number: int, *, tmux: bool = False) -> str:
    """Return what makes kitty forget a picture."""
    return wrapped(f"\x1b_Ga=d,d=I,i={number},q=2\x1b\\", tmux=tmux)


def placeholders(row: int, columns: int) -> list[str]:
    """Return the cells of a row of a picture: each says which part of it belongs there."""
    return [f"{PLACEHOLDER}{DIACRITICS[row]}{DIACRITICS[column]}" for column in range(columns)]


# -- sixel -----------------------------------------------------------------------------------------

_REPEATED = re.compile(rb"(.)\1{3,254}", re.DOTALL)
_SIXEL = bytes((value + 63) & 0xFF for value in range(256))


def sixel(jpeg: bytes, width: int, height: int, marks: Sequence[tuple[float, float]] = ()) -> str:
    """Return a picture in sixels.

    Args:
        jpeg: the picture.
        width: in which it is drawn [px].
        height: likewise.
        marks: shares of width and height at which a small square is drawn.

    Raises:
        OSError: it is no picture.
    """
    with Image.open(io.BytesIO(jpeg)) as picture:
        scaled = picture.convert("RGB").resize((width, height), Image.Resampling.BOX)
    for across, down in marks:
        x, y = across * width, down * height
        ImageDraw.Draw(scaled).rectangle(
            (x - 3, y - 3, x + 3, y + 3), fill=(255, 255, 255), outline=(0, 0, 0)
        )
    reduced = scaled.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette = reduced.getpalette() or []
    pixels = reduced.tobytes()
    out = [f'\x1bP0;1;0q"1;1;{width};{height}']
    for colour in range(min(COLOURS, len(palette) // 3)):
        red, green, blue = (round(each * 100 / 255) for each in palette[3 * colour : 3 * colour + 3])
        out.append(f"#{colour};2;{red};{green};{blue}")
    for top in range(0, height, 6):
        band = [pixels[row * width : (row + 1) * width] for row in range(top, min(top + 6, height))]
        drawn = [f"#{colour}{_line(band, colour)}" for colour in sorted(set(b"".join(band)))]
        out.append("$".join(drawn) + "-")
    return "".join(out) + "\x1b\\"


def _line(band: list[bytes], colour: int) -> str:
    """Return one colour of six rows: a bit for each row, from above."""
    width, bits = len(band[0]), 0
    for row, pixels in enumerate(band):
        table = bytearray(256)
        table[colour] = 1 << row
        bits |= int.from_bytes(pixels.translate(table), "big")
    columns = bits.to_bytes(width, "big").translate(_SIXEL).rstrip(b"?")
    return _REPEATED.sub(lambda run: b"!%d%c" % (len(run[0]), run[0][0]), columns).decode("ascii")
