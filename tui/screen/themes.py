"""The colours: calm by day and by night, red only where something is wrong; and those of files.

An operator's own are files with a theme each, beside the file of keys:

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
from collections.abc import Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, cast

from textual.color import Color, ColorParseError
from textual.theme import Theme

from robotree import files
from robotree.tui.errors import BadTheme
from robotree.tui.screen.palette import COLOURS, reduced_theme

DARK = Theme(
    name="robotree-dark",
    primary="#7fb4ca",
    secondary="#938aa9",
    accent="#e6c384",
    foreground="#d8dbe2",
    background="#14171d",
    surface="#1a1e26",
    panel="#232833",
    success="#98bb6c",
    warning="#e6a65d",
    error="#e46876",
    dark=True,
    variables={
        "block-cursor-background": "#2f3b4d",
        "block-cursor-foreground": "#ffffff",
        "block-cursor-text-style": "none",
        "footer-key-foreground": "#7fb4ca",
        "stop": "#c8102e",
        "banner": "#5f1a24",
        "border": "#3a4250",
        "border-blurred": "#2a303b",
    },
)

LIGHT = Theme(
    name="robotree-light",
    primary="#2f6f8f",
    secondary="#6d6390",
    accent="#8a6412",
    foreground="#23272e",
    background="#f6f5f1",
    surface="#efede7",
    panel="#e4e1d8",
    success="#4c7a2a",
    warning="#a25a0c",
    error="#b3263a",
    dark=False,
    variables={
        "block-cursor-background": "#cfdfe8",
        "block-cursor-foreground": "#10141a",
        "block-cursor-text-style": "none",
        "footer-key-foreground": "#2f6f8f",
        "stop": "#c8102e",
        "banner": "#f4c8cc",
        "border": "#c3beb0",
        "border-blurred": "#d8d4c8",
    },
)

COLOUR_BLIND = replace(
    DARK,
    name="robotree-colour-blind",
    primary="#56b4e9",
    secondary="#cc79a7",
    accent="#f0e442",
    success="#56b4e9",
    warning="#e69f00",
    error="#d55e00",
    variables={**DARK.variables, "stop": "#d55e00", "banner": "#5f2a00"},
)
"""Blue is well, orange and vermilion are not; no green (Okabe and Ito, Color Universal Design, 2008)."""

OURS = (DARK, LIGHT, COLOUR_BLIND)
REDUCED = {theme.name: reduced_theme(theme) for theme in OURS}
"""The same for terminals of 256 colours, by the name of the whole one."""


_BRIGHT = {
    "primary": "#55ffff",
    "secondary": "#ff55ff",
    "accent": "#ffff55",
    "foreground": "#ffffff",
    "background": "#000000",
    "surface": "#000000",
    "panel": "#0000aa",
    "success": "#55ff55",
    "warning": "#ffff55",
    "error": "#ff5555",
}
_DEEP = {
    "primary": "#0000aa",
    "secondary": "#aa00aa",
    "accent": "#aa5500",
    "foreground": "#000000",
    "background": "#ffffff",
    "surface": "#ffffff",
    "panel": "#aaaaaa",
    "success": "#00aa00",
    "warning": "#aa5500",
    "error": "#aa0000",
}
"""Colours that terminals of 16 colours have, as the VGA palette defines them (Rich's standard palette)."""


def _of_sixteen(theme: Theme) -> Theme:
    """Return a theme for terminals of 16 colours, in which each state keeps a colour of its own."""
    colours: dict[str, Any] = _BRIGHT if theme.dark else _DEEP
    if theme is COLOUR_BLIND:
        colours = {**colours, "success": "#55ffff", "primary": "#5555ff"}
    variables = {
        "block-cursor-background": "#0000aa" if theme.dark else "#55ffff",
        "block-cursor-foreground": colours["foreground"],
        "block-cursor-text-style": "none",
        "footer-key-foreground": colours["primary"],
        "error-on-panel": colours["foreground"] if theme.dark else colours["error"],  # no red on blue
        "stop": "#aa0000",
        "banner": "#aa0000" if theme.dark else "#ff5555",
        "border": "#aaaaaa",
        "border-blurred": "#555555",
    }
    return replace(
        theme,
        name=f"{theme.name}-16",
        variables=variables,
        **colours,
    )


SIXTEEN = {theme.name: _of_sixteen(theme) for theme in OURS}
"""The same for terminals of 16 colours, by the name of the whole one."""


def chosen(wanted: str, color_system: str | None, others: Sequence[Theme] = ()) -> Theme:
    """Return the theme for a terminal.

    Args:
        wanted: by name, with or without `robotree-`; unknown or empty: the dark one.
        color_system: of the terminal, as Rich names it: `truecolor`, `256`, `standard`, or None.
        others: beside ours; where there are 16 colours the one of ours that is as dark is taken instead.
    """
    found = next(
        (one for one in (*OURS, *others) if wanted in {one.name, one.name.removeprefix("robotree-")}), DARK
    )
    if color_system in {"standard", "windows"}:
        return SIXTEEN[found.name if found in OURS else (DARK if found.dark else LIGHT).name]
    return found if color_system == "truecolor" else REDUCED.get(found.name) or reduced_theme(found)


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
