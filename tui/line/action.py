"""The definition of one action of a person: its words, its keys, and where they work."""

from __future__ import annotations

from enum import Enum, Flag, auto
from typing import NamedTuple

from robotree.tui.line import grammar
from robotree.tui.line.grammar import Shape


class Where(Flag):
    """On which surfaces an action can be asked for."""

    SHELL = auto()
    """As `robotree VERB …`."""
    PROMPT = auto()
    """At the `:` of the full screen."""
    SCRIPT = auto()
    """As a line of a session script."""
    SCREEN = auto()
    """By key or from the palette of the full screen."""


class About(Enum):
    """The part of the main page that a key concerns."""

    NOTHING = auto()
    ROBOT = auto()
    """The selected robot: no key where none can be selected."""
    SLOT = auto()
    """The selected slot; in a list without slots the selected robot, whose slots are asked about then."""


class Scope(Enum):
    """Where in the full screen a key works."""

    PAGE = auto()
    """On the main page."""
    PROGRAM = auto()
    """On every page, whatever has the focus (a button too), except a field that one types in."""


LOOK, SHAPE, COMMAND, PROCESS, SCREEN = "Look", "Shape the tree", "Command", "Run", "Screen"
WIRE, SCRIPTS, AUTHOR = "Wire", "Scripts and roles", "Write a page"
"""The groups of the help."""

RIGHT_NAMES = (
    *("see", "command", "ask", "take", "order", "create", "release", "migrate", "resume", "administrate"),
)
"""The rights of a policy (`vr/base/policy.py`, which help does not load; a test compares them)."""

ANYWHERE = Where.SHELL | Where.PROMPT | Where.SCRIPT | Where.SCREEN
SHOWN = Where.PROMPT | Where.SCREEN
LINES = Where.SHELL | Where.PROMPT | Where.SCRIPT


class Action(NamedTuple):
    """One thing that can be done."""

    usage: str
    """Verb and values, as `grammar.shape` reads them."""
    help: str
    """One sentence."""
    group: str
    run: str = ""
    """Its function over a realm (`carrying.Run`), on every surface: `module:function` below `robotree.tui`,
    as entry points are written, for help loads none of them; empty: it has none."""
    start: str = ""
    """What it starts in a shell, written in the same way (`carrying.Program`); empty: its `run` is carried
    out over the realm, and printed."""
    where: Where = LINES
    key: str = ""
    """Key in the full screen, as Textual names it."""
    typing_key: str = ""
    """A second key, which works even while one types. Both come before whatever has the focus."""
    scope: Scope = Scope.PAGE
    """Where its keys work."""
    about: About = About.NOTHING
    """The part of the main page that its key concerns."""
    label: str = ""
    """Word beside the key in the footer; empty: not shown there."""
    danger: bool = False
    """It takes something away or makes something move: the full screen asks first."""
    while_busy: bool = False
    """Its keys work while the form in front carries something out. All other keys are dropped then, and that
    is told: this is true of every form, and said nowhere else."""
    alters: bool = False
    """It changes robots, who commands them, or what all operators see: absent where one may only look
    (`--readonly`, a replay)."""
    writes: bool = False
    """It can write a file into the folder of the program: where one may only look it works in a shell alone,
    whose person owns the folder."""
    members: str = ""
    """The blank in which it may name a group, for each of whose members it is carried out; empty: none."""
    shell_options: tuple[str, ...] = ()
    """Options that only a shell takes: with them it goes on until it is interrupted, or leaves the realm."""
    needs: tuple[str, ...] = ()
    """The extras of pyproject.toml without which it cannot begin; see `robotree.vr.base.extras`."""
    right: str = ""
    """The right of a policy that it needs (`vr/base/policy.py`); empty: none, or several."""
    examples: tuple[str, ...] = ()
    guide: tuple[str, ...] = ()
    """Modules whose docstrings explain it further: `robotree help VERB` prints them."""

    @property
    def shape(self) -> Shape:
        """The usage string, compiled."""
        return grammar.shape(self.usage)

    @property
    def verb(self) -> str:
        """The lower-case words with which the usage begins."""
        return grammar.verb(self.usage)


_SPELLED = {
    "left_parenthesis": "(", "right_parenthesis": ")",
    "question_mark": "?", "slash": "/", "colon": ":", "comma": ",", "full_stop": ".",
    "escape": "esc", "enter": "⏎", "up": "↑", "down": "↓", "left": "←", "right": "→",
    "greater_than_sign": ">", "pageup": "pgup", "pagedown": "pgdn",
}  # fmt: skip


def spell(key: str) -> str:
    """Return a key, as Textual names it, as it is printed on keyboards."""
    return _SPELLED.get(key, key)
