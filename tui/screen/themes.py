"""The colours: calm by day and by night, red only where something is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from textual.theme import Theme

from robotree.tui.screen.palette import reduced_theme

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
