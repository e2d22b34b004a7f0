"""The one registry of what a person can do: a file for each family of verbs.

It feeds the keys and the footer, the help screen, the palette, the `:` prompt, the command line and the
session scripts. Whatever is not here cannot be done anywhere; whatever is here reads the same everywhere.
"""

from __future__ import annotations

from robotree.tui.line.action import Action, Where
from robotree.tui.line.actions import (
    commanding,
    looking,
    operators,
    pages,
    policies,
    processes,
    recordings,
    screen,
    screens,
    scripts,
    sessions,
    shaping,
    wire,
)
from robotree.tui.line.grammar import Shape

ACTIONS: tuple[Action, ...] = (
    *looking.VERBS, *recordings.VERBS, *pages.VERBS, *shaping.VERBS, *commanding.VERBS,
    *operators.VERBS, *scripts.VERBS, *screens.VERBS, *sessions.VERBS,
    *processes.VERBS, *policies.VERBS, *wire.VERBS, *screen.VERBS,
)  # fmt: skip
BY_VERB = {action.verb: action for action in ACTIONS}


def shapes(where: Where) -> dict[str, Shape]:
    """Return the verbs of a kind of surface; `Surface` knows what is absent there now."""
    return {action.verb: action.shape for action in ACTIONS if where in action.where}
