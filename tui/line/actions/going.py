"""Robots are sent to places."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, COMMAND, LOOK, About, Action

of_robot = partial(Action, group=COMMAND, where=ANYWHERE, about=About.ROBOT)

VERBS = (
    of_robot(
        "go ROBOT PLACE|COORDINATE=VALUE … [--preview] [--within TIME]",
        "Send a robot to a named place, `@shelf`, or to a point, x=0.3 y=0.1 z=0.2; what is not given"
        " stays as it is. The robot is asked first whether it would; --preview: only that, nothing moves.",
        run="line.going:go",
        right="command",
        key="G",
        alters=True,
        examples=("go arm-1 @shelf --preview", "go arm-1 @shelf", "go rover-1 x=0.5 y='-20 cm'"),
        guide=("robotree.tui.line.going",),
    ),
    Action(
        "places [ROBOT]",
        "List the named places, or those that a robot can be sent to.",
        group=LOOK,
        run="line.going:places",
        right="see",
        examples=("places", "places arm-1 --json"),
    ),
    of_robot(
        "places add NEW of ROBOT [COORDINATE=VALUE …]",
        "Name the point where a robot is now, or x, y, z, twist, heading in its frame. `@NEW` then"
        " stands for it wherever a command asks for a pose: `call arm-1.go_to @shelf`.",
        run="line.going:places_add",
        right="command",
        key="K",
        alters=True,
        examples=("places add shelf of arm-1", "places add dock of rover-1 x=0 y=0"),
        guide=("robotree.tui.line.going",),
    ),
    Action(
        "places remove PLACE",
        "Forget a named place.",
        group=COMMAND,
        run="line.going:places_remove",
        alters=True,
        examples=("places remove shelf",),
    ),
)
