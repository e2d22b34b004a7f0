"""Commands of robots, how they are held, answered and stopped; places; orders for who is away or busy."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, COMMAND, LOOK, About, Action, Scope, Where

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
        run="line.permits:questions",
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
    Action(
        "orders [NAME] [--mine] [--all]",
        "List what is left for robots that are away or busy, and the results that wait. NAME: for one"
        " robot. --mine: only yours. --all: those, too, whose results have been taken.",
        group=COMMAND,
        where=ANYWHERE,
        run="line.ordering:orders",
        right="see",
        key="A",
        examples=("orders", "orders rover-1 --mine --json"),
    ),
    line(
        "order show TICKET",
        "Show one order: its arguments, its state, who has a copy of it.",
        run="line.ordering:order_show",
        right="see",
        examples=("order show 3fa2",),
    ),
    line(
        "order cancel TICKET",
        "End an order, also one that its robot carries out; names the directories that have not"
        " confirmed it.",
        run="line.ordering:order_cancel",
        right="order",
        examples=("order cancel 3fa2",),
        alters=True,
    ),
    line(
        "order confirm TICKET",
        "Let an order begin though its robot asks: somebody has commanded it since.",
        run="line.ordering:order_confirm",
        right="order",
        examples=("order confirm 3fa2",),
        alters=True,
    ),
    line(
        "order settle TICKET OUTCOME",
        "Say what became of an order in doubt, after a look at the robot: OUTCOME is done or undone.",
        run="line.ordering:order_settle",
        right="order",
        examples=("order settle 3fa2 undone",),
        alters=True,
    ),
    line(
        "inbox [--keep]",
        "Print the results of your orders, and take them out of the inbox; --keep: leave them there.",
        run="line.ordering:inbox",
        examples=("inbox", "inbox --keep --json"),
    ),
    Action(
        "take NAME … [--as DEVICE]",
        "Put what is known of robots onto this machine: without any network `call --queue`, `orders`,"
        " `order show`, `order cancel`, `show` and `ls` work then, and orders are left at the next contact."
        " DEVICE: a name of this machine, whose orders have an inbox of their own.",
        group=COMMAND,
        where=Where.SHELL,
        run="line.taken:take",
        right="order",
        examples=("take rover-1 arm-1", "take rover-1 --as notebook"),
    ),
)
