"""Several operators: who is here, and who has control of a robot."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, COMMAND, LOOK, About, Action

anywhere = partial(Action, group=LOOK, where=ANYWHERE)
of_robot = partial(Action, group=COMMAND, where=ANYWHERE, about=About.ROBOT)

VERBS = (
    anywhere(
        "who",
        "List the operators who are here, on which page, and who has control of which robots.",
        run="line.operators:who",
        key="6",
        examples=("who", "who --json"),
    ),
    anywhere(
        "say TEXT …",
        "Say a line to all operators: their logs show it.",
        run="line.operators:say",
        key="7",
        examples=("say 'I leave for lunch'",),
    ),
    of_robot(
        "control get NAME [--for TIME]",
        "Get control of a robot that nobody has, or that is offered to you: nobody else moves it then."
        " It lasts as long as this program, from a shell 10 min (--for).",
        run="line.operators:control",
        right="command",
        key="1",
        examples=("control get arm-1", "control get arm-1 --for 1h"),
        guide=("robotree.vr.core.control",),
        alters=True,
    ),
    of_robot(
        "control ask NAME [--for TIME]",
        "Ask the operator who has control of a robot for it; the question stays open for 30 s.",
        run="line.operators:control",
        right="command",
        key="2",
        examples=("control ask arm-1",),
        alters=True,
    ),
    of_robot(
        "control offer NAME [PERSON]",
        "Hand control of a robot over to who asks for it, or offer it to a PERSON for 30 s.",
        run="line.operators:control",
        right="command",
        key="3",
        examples=("control offer arm-1", "control offer arm-1 ben@pts/4"),
        alters=True,
    ),
    of_robot(
        "control take NAME [--for TIME] [--seen N]",
        "Take control of a robot from the operator who has it, and end what that one has begun."
        " --seen: only if it has changed hands N times so far.",
        run="line.operators:control",
        right="take",
        key="4",
        danger=True,
        examples=("control take arm-1",),
        alters=True,
    ),
    of_robot(
        "control leave NAME",
        "Give control of a robot up, or take back the question for it.",
        run="line.operators:control",
        key="5",
        examples=("control leave arm-1",),
        alters=True,
    ),
)
