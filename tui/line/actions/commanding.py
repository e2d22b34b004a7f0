"""Commands of robots, and how they are held, answered and stopped."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, COMMAND, About, Action, Scope

line = partial(Action, group=COMMAND)
of_robot = partial(Action, group=COMMAND, where=ANYWHERE, about=About.ROBOT)
anywhere = partial(Action, group=COMMAND, where=ANYWHERE)

VERBS = (
    line(
        "call ROBOT.COMMAND [PARAMETER=VALUE …] [--within TIME] [--detach | --queue | --save FILE]"
        " [--until WHEN] [--robot IDENTITY] [--trace]",
        "Have a command carried out: progress on stderr, result on stdout. It ends with this program;"
        " with --detach it goes on by itself. --save: write the picture in its result into a file."
        " --queue: leave it as an order, which the robot carries out when it is there and free; --until:"
        " in which time it must begin, 2h or 18:00 (24h); --robot: which of several robots of this name that"
        " are away. --trace shows the way of a failure through the"
        " authors' pages.",
        members="ROBOT.COMMAND",
        run="line.ordering:call_or_leave",
        right="command",
        examples=(
            "call lever.close",
            "call mover.move x=0.4 y=0 z='30 cm' twist='90 deg' --within 30s",
            "call rover-1.move x=1 y=0 --queue --until 2h",
        ),
        alters=True,
    ),
    of_robot(
        "cancel NAME",
        "End the commands of a robot, running and waiting.",
        members="NAME",
        run="line.verbs:cancel",
        right="command",
        key="c",
        examples=("cancel mover",),
        alters=True,
    ),
    of_robot(
        "pause NAME",
        "Have a virtual robot, and those below it, wait before each step; new commands wait, too."
        " What moves now ends by itself; deadlines go on.",
        members="NAME",
        run="line.verbs:pause",
        right="command",
        key="b",
        examples=("pause mover",),
        alters=True,
    ),
    of_robot(
        "step NAME",
        "Let one step of a paused robot pass, of its own or of a robot below it.",
        run="line.verbs:step",
        right="command",
        key="greater_than_sign",
        examples=("step mover",),
        alters=True,
    ),
    of_robot(
        "continue NAME",
        "End the pause of a robot and of those below it.",
        members="NAME",
        run="line.verbs:continue_",
        right="command",
        key="B",
        examples=("continue mover",),
        alters=True,
    ),
    line(
        "questions",
        "List what scripts ask people, and commands that ask after a crash, with their answers.",
        run="line.questions:questions",
        right="see",
        examples=("questions", "questions --json"),
    ),
    line(
        "decide NAME ANSWER [--question ID]",
        "Answer what a script asks, or a command that asks after a crash: it is done, goes on"
        " (again), or ends (abort). --question: only if it is still this one.",
        run="line.verbs:decide",
        right="command",
        examples=("decide mover again", "decide guide yes"),
        alters=True,
    ),
    anywhere(
        "stop [NAME] [--everywhere]",
        "Protective stop of one robot, or of everything, now; --everywhere: in all your realms.",
        members="NAME",
        run="line.verbs:stop",
        start="line.stopping:stop",
        shell_options=("--everywhere",),
        right="stop",
        key="space",
        typing_key="ctrl+s",
        scope=Scope.PROGRAM,
        while_busy=True,
        examples=("stop", "stop arm-1", "stop --everywhere"),
    ),
    anywhere(
        "resume [NAME]",
        "Resume after a protective stop; nothing moves by itself.",
        members="NAME",
        run="line.verbs:resume",
        right="resume",
        key="R",
        scope=Scope.PROGRAM,
        danger=True,
        examples=("resume",),
        alters=True,
    ),
)
