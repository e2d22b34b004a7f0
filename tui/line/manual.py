"""The help texts, made from the registry of actions, so that they are never stale. Pure."""

from __future__ import annotations

import textwrap
from typing import Any

from robotree.tui.line.action import Action, Where, spell
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.line.surface import Surface

EVERYWHERE = {"json": "", "realm": "NAME", "readonly": "", "calm": "", "plain": "", "help": "", "version": ""}
"""Options that every verb takes on the command line, before the verb or behind it."""

INTERNAL = {"tether": ""}
"""Options for programs that start others (`processes/crew.py`)."""

WIDTH, INDENT = 108, 38
"""Columns of the help, and where explanations begin."""

_HEAD = """\
robotree supervises robots through virtual robots: see every robot on the network, write a virtual robot in a
page of Python, put it on top of other robots while everything runs, and command the new one.

usage: robotree [VERB …] [--json] [--realm NAME] [--readonly]      without a verb: the full screen
"""

WALK = """\
A first walk, with everything in one terminal:
  robotree demo                                   simulated arm and rover, and the full screen
The same by hand, in a second terminal while the demo runs:
  robotree ls
  robotree create examples/move_to.py as mover
  robotree enslave mover.arm arm-1
  robotree call mover.move x=0.45 y=0 z='30 cm' twist=0
  robotree tree

--json prints one JSON value, of an error too. --realm NAME (or $ROBOTREE_REALM) keeps groups of agents apart.
--readonly (or $ROBOTREE_READONLY=1) leaves only what looks, and the protective stop.
--calm (or $ROBOTREE_CALM=1) is for slow lines: the full screen without pictures, drawn seldom.
--plain (or $ROBOTREE_PLAIN=1) is for screen readers: `robotree` says in lines what changes, and takes verbs.
exit codes: 0 done · 1 refused or failed · 2 not understood · 3 nobody answers · 130 interrupted
robotree help VERB explains one verb."""
"""The end of the overview; its lines are typed as they are (a test does)."""


def shell(*, readonly: bool = False) -> Surface:
    """Return what the command line offers."""
    return Surface(Where.SHELL, readonly, EVERYWHERE, INTERNAL)


def overview(surface: Surface) -> str:
    """Return what `robotree --help` prints."""
    blocks = [_HEAD]
    for group, actions in surface.groups.items():
        rows = [_row(action) for action in actions]
        blocks.append("\n".join([group, *rows, ""]))
    return "\n".join([*blocks, WALK])


def _row(action: Action) -> str:
    usage = textwrap.wrap(action.usage, WIDTH, initial_indent="  ", subsequent_indent="      ")
    about = textwrap.wrap(action.help, WIDTH - INDENT)
    if len(usage) == 1 and len(usage[0]) < INDENT - 1:
        about[0] = f"{usage[0]:<{INDENT}}{about[0]}"
        usage = []
    else:
        about[0] = " " * INDENT + about[0]
    return "\n".join([*usage, about[0], *(" " * INDENT + line for line in about[1:])])


def family(word: str, surface: Surface) -> str:
    """Return the help of a verb and of those of two words that begin with it; empty: none does."""
    rows = [_row(action) for action in surface.actions if action.verb.startswith(f"{word} ")]
    if not rows:
        return ""
    alone = [page(word), ""] if word in surface.shapes else []
    return "\n".join([*alone, *rows, "", f"robotree help {word} VERB explains one of them."])


def structure(action: Action) -> dict[str, Any]:
    """Return an action as plain data, for `help --json`."""
    return {
        "verb": action.verb,
        "usage": action.usage,
        "help": action.help,
        "group": action.group,
        "key": spell(action.key),
        "alters": action.alters,
        "examples": list(action.examples),
    }


def man_page(surface: Surface) -> str:
    """Return the manual page robotree(1) in the language of man(7): every verb, by groups."""
    title = '.TH ROBOTREE 1 "" "robotree" "User commands"'
    lines = [title, ".SH NAME", "robotree \\- supervise robots through virtual robots", ".SH SYNOPSIS"]
    lines += [".B robotree", _roff("[VERB …] [--json] [--realm NAME] [--readonly]"), ".SH DESCRIPTION"]
    lines += [_roff(_HEAD.partition("\n\n")[0].replace("\n", " ")), ".SH VERBS"]
    for group, actions in surface.groups.items():
        lines.append(f".SS {_roff(group)}")
        for action in actions:
            lines += [".TP", f".B {_roff(action.usage)}", _roff(action.help)]
            for example in action.examples:
                lines += [".br", f".I {_roff(f'robotree {example}')}"]
    walk, notes = WALK.split("\n\n", 1)
    lines += [".SH NOTES", *(f"{_roff(line)}\n.br" for line in notes.splitlines())]
    return "\n".join([*lines, ".SH EXAMPLE", ".nf", *map(_roff, walk.splitlines()), ".fi", ""])


def _roff(text: str) -> str:
    """Return a text as man(7) prints it: backslashes and hyphens as they are, no line a request."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{escaped}" if escaped.startswith((".", "'")) else escaped


def tables() -> str:
    """Return the registry as two tables for the guide: what can be done, and the keys of each page."""
    from robotree.tui.line.page_keys import PAGE_KEYS

    rows = ["| what | key | verb |", "|---|---|---|"]
    for action in ACTIONS:
        keys = [f"`{spell(key)}`" for key in (action.key, action.typing_key) if key]
        typed = action.where & (Where.PROMPT | Where.SHELL)
        verb = f"`{action.usage}`".replace("|", "\\|") if typed else ""
        shell = " (shell)" if typed == Where.SHELL else ""
        rows.append(f"| {action.help.replace('|', chr(92) + '|')} | {' '.join(keys)} | {verb}{shell} |")
    rows += ["", "| page | key | what |", "|---|---|---|"]
    rows += [
        f"| {one.page} | {' '.join(f'`{spell(key)}`' for key in one.key.split(','))} | {one.help} |"
        for one in PAGE_KEYS
    ]
    return "\n".join([*rows, ""])


def page(verb: str) -> str:
    """Return the help of one verb.

    Raises:
        KeyError: there is no such verb.
    """
    action = BY_VERB[verb]
    lines = [f"usage: robotree {action.usage}", "", action.help]
    if action.examples:
        lines += ["", "examples:", *(f"  robotree {example}" for example in action.examples)]
    if action.key:
        lines += ["", f"key in the full screen: {spell(action.key)}"]
    for module in action.guide:
        from importlib import import_module

        lines += ["", (import_module(module).__doc__ or "").strip().replace(" Pure.", "").replace("`", "")]
    return "\n".join(lines)
