"""All keys and verbs, from the registry."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text

from robotree.tui.actions import Where, groups
from robotree.tui.manual import spell
from robotree.tui.widgets.marks import tint

if TYPE_CHECKING:
    from robotree.tui.app import Supervisor

PANEL = (
    ("enter", "into the form, and on to the next field; it never runs anything"),
    ("ctrl+r", "run the command as it is filled in"),
    ("x c i", "tele-operate, cancel, about: at the list of commands"),
)
TELEOP = (
    ("←→↑↓", "move left, right, forward, back"),
    ("pgup pgdn", "move up, down"),
    (", .", "twist the gripper"),
    ("+ -", "larger, smaller steps"),
    ("o c", "open, close the gripper"),
    ("v", "look through the next camera"),
)


def help_text(app: Supervisor) -> Text:
    """Return the help page."""
    strong, muted = tint(app, "primary", bold=True), tint(app, "muted")
    text = Text()
    text.append("Protective stop\n", tint(app, "error", bold=True))
    text.append("  space   ", strong)
    text.append("stops every robot at once, on every page. While you type in a field, space is a space:\n")
    text.append("  ctrl+s  ", strong)
    text.append("stops every robot even then. R releases the stop; nothing moves by itself.\n")
    text.append("\nKeys\n", strong)
    for actions in groups(Where.SCREEN).values():
        for action in actions:
            if action.key and action.key != "space":
                text.append(f"  {spell(action.key):<8}", strong)
                leaving = f"Leave. {app.farewell}" if action.verb == "quit" and app.farewell else ""
                text.append(f"{leaving or action.help}\n")
    text.append(f"  {'esc':<8}", strong)
    text.append("Back.\n")
    text.append(f"  {'ctrl+p':<8}", strong)
    text.append("Palette: everything by name, colours, a screenshot.\n")
    text.append("\nPanel\n", strong)
    for keys, meaning in PANEL:
        text.append(f"  {keys:<8}", strong)
        text.append(f"{meaning}\n")
    text.append("\nTele-operation (x in the panel of an arm)\n", strong)
    for keys, meaning in TELEOP:
        text.append(f"  {keys:<10}", strong)
        text.append(f"{meaning}\n")
    text.append("\nVerbs", strong)
    text.append("  at the `:` prompt, on the command line after `robotree`, and in session scripts\n", muted)
    for actions in groups(Where.PROMPT).values():
        for action in actions:
            text.append(f"  {action.usage}\n", "bold")
            text.append(f"      {action.help}\n", muted)
    text.append("\nSigns\n", strong)
    text.append("  ● free   ◐ busy   ◆ enslaved   ■ stopped   ✗ offline   ◌ silent\n")
    return text
