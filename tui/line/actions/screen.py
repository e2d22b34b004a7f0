"""What the full screen alone does."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import SCREEN, SHOWN, About, Action, Scope, Where

shown = partial(Action, group=SCREEN, where=SHOWN)
typed = partial(Action, group=SCREEN, where=Where.PROMPT)
key_of_robot = partial(Action, group=SCREEN, where=Where.SCREEN, about=About.ROBOT)
key = partial(Action, group=SCREEN, where=Where.SCREEN)

VERBS = (
    Action(
        "panel",
        "Open the panel of the selected robot: a form for each command.",
        group=SCREEN,
        where=Where.SCREEN,
        about=About.SLOT,
        key="enter",
        label="Panel",
        alters=True,
    ),
    shown("robots", "Go back to the list of robots.", key="l"),
    shown(
        "sort",
        "Sort the robots in the next way: problems first, then by name, kind, state, by, host.",
        key="S",
    ),
    shown("divide", "Divide the list of robots into parts: by site, kind or state, or not at all.", key="I"),
    shown("larger", "Give more of the page to what is below the list.", key="plus"),
    shown("smaller", "Give less of the page to what is below the list.", key="minus"),
    shown("broader", "Give more of what is below the list to the picture.", key="right_parenthesis"),
    shown("narrower", "Give less of what is below the list to the picture.", key="left_parenthesis"),
    shown("view next", "Use the next saved filter; after the last one show all robots.", key="N"),
    typed("view use NAME", "Filter the list by what was saved under a NAME; `:view NAME` does the same."),
    typed(
        "view save NAME", "Save the present filter of the list of robots under a NAME; it is kept for you."
    ),
    typed("view drop NAME", "Forget a saved filter."),
    shown(
        "wide",
        "Give the whole page to the list, with more columns (epoch, lease, process), and back.",
        key="w",
    ),
    shown("joints", "Show each joint of the selected robot in its own line, and back.", key="J"),
    key_of_robot(
        "mark",
        "Mark the selected robot, or remove its mark: cancel and delete apply to all marked robots.",
        key="m",
    ),
    shown(
        "theme [NAME]",
        "Show the screen in other colours: those of NAME, or the next ones; dark, light, colour-blind, and"
        " your files.",
        key="f8",
        examples=("theme light",),
    ),
    shown(
        "language [LANGUAGE]",
        "Show the words of the screen in another LANGUAGE, or the next one: en, de, ar. Verbs stay as they"
        " are.",
        key="f9",
        examples=("language de",),
    ),
    shown("unmark", "Remove all marks.", key="M"),
    key_of_robot(
        "dismiss", "Remove a robot that hangs or has gone from the list; it returns when it answers.", key="D"
    ),
    shown(
        "plan",
        "Show the place of the selected robot from above: robots, named places, the way to the cursor.",
        key="F",
    ),
    shown(
        "readings",
        "Show readings over time: tick those of the selected robot, look back, and set alarms.",
        key="U",
    ),
    key_of_robot(
        "messages",
        "Show the messages on the wire of a proxy: rate, age, fields; a ticked field is drawn over time.",
        key="Q",
    ),
    shown("views", "Show pictures of the workspaces.", key="v"),
    shown("level", "Change the level of the log: all, warnings and errors, errors only.", key="L"),
    shown("together", "Show all cameras side by side, and back.", key="Y"),
    shown(
        "skeleton",
        "Show the arm of a view as a skeleton, by its joints, for lines too thin for pictures, and back.",
        key="y",
    ),
    shown("camera", "Show the picture of the next camera.", key="V"),
    key("filter", "Show only rows that contain these letters.", key="slash", label="Filter"),
    key("prompt", "Type a verb.", key="colon", scope=Scope.PROGRAM, while_busy=True, label="Verb"),
    Action(
        "help",
        "Show all keys and verbs.",
        group=SCREEN,
        where=SHOWN | Where.SHELL,
        key="question_mark",
        typing_key="f1",
        scope=Scope.PROGRAM,
        label="Help",
    ),
    shown("quit", "Leave; the robots stay as they are.", key="q", label="Quit"),
)
