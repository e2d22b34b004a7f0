"""What the terminal of this process does with pictures, without writing anything into it."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
import sys
import termios
from functools import cache
from typing import NamedTuple

from robotree.tui.seen.graphics import Graphics, ability

TMUX_WITHIN = 0.5
"""[s] for tmux to answer: it does in 5 ms, and a screen that opens without pixels is no harm."""


class PictureAbility(NamedTuple):
    """How pictures are drawn here."""

    graphics: Graphics = "cells"
    cell: tuple[int, int] = (0, 0)
    """[px] width and height of a cell; zeros: the terminal does not say."""
    tmux: bool = False
    """Whether what is sent must be wrapped for tmux."""


CELLS = PictureAbility()
"""In half cells, as in every terminal."""


@cache
def ask_tmux(form: str) -> str:
    """Return what the tmux around this process says of a format; empty: it says nothing."""
    name = form.removeprefix("#{").removesuffix("}")
    shown = ["show-options", "-gqv", name] if name == "allow-passthrough" else ["display-message", "-p", form]
    try:
        said = subprocess.run(
            ["tmux", *shown],  # noqa: S607 # the tmux around us is in the path
            capture_output=True,
            text=True,
            timeout=TMUX_WITHIN,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return said.stdout.strip()


def pictures_here() -> PictureAbility:
    """Return how pictures are drawn in the terminal that standard error is, where Textual draws."""
    graphics = ability(os.environ, ask_tmux)
    if graphics == "cells":
        return CELLS
    cell = cell_size()
    tmux = bool(os.environ.get("TMUX"))
    if graphics == "sixel":  # tmux draws sixels itself; without the size of a cell they would not fit
        return PictureAbility(graphics, cell) if all(cell) else CELLS
    return PictureAbility(graphics, cell, tmux)


def cell_size() -> tuple[int, int]:
    """Return width and height of a cell [px], as the terminal has told the kernel; zeros: it has not."""
    try:
        raw = fcntl.ioctl(sys.__stderr__ or 2, termios.TIOCGWINSZ, bytes(8))
    except OSError:
        return 0, 0
    rows, columns, width, height = struct.unpack("HHHH", raw)
    return (width // columns, height // rows) if rows and columns else (0, 0)
