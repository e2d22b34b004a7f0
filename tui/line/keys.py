"""How keys are printed on keyboards. Pure."""

from __future__ import annotations

_SPELLED = {
    "left_parenthesis": "(", "right_parenthesis": ")",
    "question_mark": "?", "slash": "/", "colon": ":", "comma": ",", "full_stop": ".",
    "escape": "esc", "enter": "⏎", "up": "↑", "down": "↓", "left": "←", "right": "→",
    "greater_than_sign": ">", "pageup": "pgup", "pagedown": "pgdn",
}  # fmt: skip


def spell(key: str) -> str:
    """Return a key, as Textual names it, as it is printed on keyboards."""
    return _SPELLED.get(key, key)
