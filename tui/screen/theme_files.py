"""Colours of an operator's own: files with a theme each, beside the file of keys.

    # $XDG_CONFIG_HOME/robotree/themes/desk.toml (~/.config/robotree/themes/desk.toml)
    based-on = "light"
    [colours]
    primary = "#005f87"
    error = "#af0000"

`:theme desk` shows it, and $TEXTUAL_THEME=desk from the start. Colours that are not named are those of the
theme that it is based on: dark, light or colour-blind. A file that is wrong anywhere is refused whole, and so
are colours in which nobody could read what robots do.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, cast

from textual.color import Color, ColorParseError
from textual.theme import Theme

from robotree import files
from robotree.tui.errors import BadTheme
from robotree.tui.screen.palette import COLOURS
from robotree.tui.screen.themes import OURS

FOLDER = "robotree/themes"
LARGEST = 100_000
"""Bytes of a file that are read."""
MOST = 100
"""Files that are read."""
OTHERS = {
    "stop": "stop",
    "banner": "banner",
    "border": "border",
    "border-blurred": "border-blurred",
    "cursor": "block-cursor-background",
    "cursor-text": "block-cursor-foreground",
    "key": "footer-key-foreground",
}
"""Colours of certain things, and the variables of our style sheet that they are."""
READABLE = 3.0
"""Contrast of text with what is behind it, at least (WCAG 2.1, 1.4.3, large text)."""
BESIDE = (
    ("foreground", "background"),
    ("foreground", "surface"),
    ("foreground", "panel"),
    ("error", "background"),
)
"""Text, and what is behind it."""


def folder() -> Path:
    """Return where the files are."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or "~/.config").expanduser() / FOLDER


def load() -> tuple[Theme, ...]:
    """Read the operator's themes, those that there are, by name.

    Raises:
        BadTheme: one cannot be read, or something in it is wrong.
    """
    found = list[Theme]()
    for path in sorted(folder().glob("*.toml"))[:MOST]:
        try:
            text = files.text(path, LARGEST)
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise BadTheme(str(path), f"it cannot be read: {reason}") from None
        found.append(read(text, path.stem, str(path)))
    return tuple(found)


def read(text: str, name: str, path: str) -> Theme:
    """Read a theme.

    Args:
        text: TOML.
        name: of the theme.
        path: named in errors.

    Raises:
        BadTheme: something in it is wrong.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadTheme(path, f"it is no TOML: {error}") from None
    if strange := document.keys() - {"based-on", "colours"}:
        raise BadTheme(path, f"{min(strange)!r} means nothing here; write based-on = ... and [colours]")
    bases = {theme.name.removeprefix("robotree-"): theme for theme in OURS}
    if name in bases or name in {theme.name for theme in OURS}:
        raise BadTheme(path, f"{name} is a theme of robotree; give the file another name")
    base = document.get("based-on", "dark")
    if not isinstance(base, str) or base not in bases:
        raise BadTheme(path, f"there is no theme {base!r} to begin with; there are {', '.join(bases)}")
    if not isinstance(table := document.get("colours", {}), dict):
        raise BadTheme(path, "colours must be a table; write [colours] and below it a line for each")
    colours = {key: _colour(key, value, path) for key, value in cast("dict[str, Any]", table).items()}
    theme = _painted(bases[base], name, colours)
    for front, back in BESIDE:
        contrast = _contrast(str(getattr(theme, front)), str(getattr(theme, back)))
        if contrast < READABLE:
            raise BadTheme(
                path, f"{front} on {back} cannot be read (contrast {contrast:.1f}, at least {READABLE:g})"
            )
    return theme


def _painted(base: Theme, name: str, colours: Mapping[str, str]) -> Theme:
    plain: dict[str, Any] = {key: colours[key] for key in COLOURS if key in colours}
    variables = {OTHERS[key]: colour for key, colour in colours.items() if key in OTHERS}
    return replace(base, name=name, variables={**base.variables, **variables}, **plain)


def _colour(key: str, value: object, path: str) -> str:
    known = (*COLOURS, *OTHERS)
    if key not in known:
        near = get_close_matches(key, known, n=2)
        hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(known)}"
        raise BadTheme(path, f"no colour is named {key!r}; {hint}")
    try:
        if isinstance(value, str):
            return Color.parse(value).hex
    except ColorParseError:
        pass
    raise BadTheme(path, f"{key}: {value!r} is no colour; write for example #005f87 or red")


def _contrast(front: str, back: str) -> float:
    """Return how much brighter one is than the other (WCAG 2.1, contrast ratio)."""
    one, other = sorted((_luminance(Color.parse(front)), _luminance(Color.parse(back))))
    return (other + 0.05) / (one + 0.05)


def _luminance(colour: Color) -> float:
    """Return the relative luminance, 0 to 1 (WCAG 2.1)."""
    parts = [part / 255 for part in colour.rgb]
    red, green, blue = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
