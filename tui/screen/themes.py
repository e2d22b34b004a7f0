"""The colours: calm by day and by night, red only where something is wrong."""

from __future__ import annotations

from textual.theme import Theme

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
        "border": "#c3beb0",
        "border-blurred": "#d8d4c8",
    },
)
