"""What shapes the tree: virtual robots are made, bound, moved and deleted."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, SHAPE, About, Action

line = partial(Action, group=SHAPE)
of_robot = partial(Action, group=SHAPE, where=ANYWHERE, about=About.ROBOT)
of_slot = partial(Action, group=SHAPE, where=ANYWHERE, about=About.SLOT)

VERBS = (
    Action(
        "create FILE as NAME [on HOST] [PARAMETER=VALUE …] [--own-host | --isolate LEVEL] [--watch]",
        "Make a virtual robot from FILE.py or FILE.py:Class, from a script, FILE.yaml or FILE.clp, or"
        " from a page that a package offers (`new` lists them); PARAMETER: one of its settings. --own-host:"
        " in a process of its own, NAME-host, which ends when it is deleted. --isolate process: in a process"
        " that its host makes for it, and that can harm nobody else. --watch (in a shell): go on, and reload"
        " it each time that the page or what belongs to it is saved.",
        group=SHAPE,
        where=ANYWHERE,
        run="line.verbs:create",
        right="create",
        key="n",
        label="New",
        examples=(
            "create examples/move_to.py as mover",
            "create mine.py:Painter as painter on host-2",
            "create team.py as team speed='20 cm/s'",
            "create team.py as team --own-host",
            "create foreign.py as guest --isolate process",
            "create team.py as team --watch",
        ),
        shell_options=("--watch",),
        alters=True,
    ),
    line(
        "service FILE NAME [on HOST] [PARAMETER=VALUE …]",
        "Start a service: a page that watches robots and brings behaviours along, NAME-BEHAVIOUR."
        " Without HOST it has a process of its own, NAME-host; `delete NAME` takes the behaviours away, too.",
        run="line.verbs:service",
        right="create",
        examples=("service examples/services/greeter.py greeter",),
        alters=True,
    ),
    of_robot(
        "set NAME PARAMETER=VALUE …",
        "Change settings of a robot, also while it works; while a parent commands it, only that may.",
        members="NAME",
        run="line.verbs:set_",
        right="command",
        key="s",
        examples=("set team speed=0.2", "set team speed='20 cm/s' label=left"),
        alters=True,
    ),
    of_robot(
        "reload NAME [FILE] [--now] [--watch]",
        "Let a robot go on with its page as it is now, from the next boundary between commands on;"
        " --now cancels the running command. --watch (in a shell): again at each save, until Ctrl-C.",
        run="line.verbs:reload",
        right="create",
        key="u",
        examples=("reload team", "reload team team.py --now", "reload team --watch --json"),
        shell_options=("--watch",),
        alters=True,
    ),
    of_slot(
        "enslave PARENT.SLOT CHILD …",
        "Put a virtual robot on top of another robot: fill its slot, or several of a group. With `where"
        " TEXT` instead of a CHILD it chooses one itself that is free: it is told why this one. A slot that"
        " only watches takes no lease: many may watch a robot, also while somebody else commands it.",
        run="line.verbs:enslave",
        right="command",
        key="e",
        label="Enslave",
        examples=(
            "enslave mover.arm arm-1",
            "enslave team.rovers rover-1 rover-2",
            "enslave watcher.seen arm-1",
            "enslave guide.rover where 'battery > 30 and near hall'",
        ),
        guide=("robotree.vr.scripts.requirement",),
        alters=True,
    ),
    line(
        "group GROUP [ROBOT …] [--where TEXT] [--near PLACE] [--delete]",
        "Give several robots one name: these ROBOTs, and all that fulfil TEXT, as `kind=Rover &"
        " battery>30`, or are at PLACE. `call`, `set`, `role`, `cancel`, `pause`, `continue`, `stop` and"
        " `resume` take the name of a group: one answer from each member.",
        run="line.groups:group",
        examples=(
            "group cleaners r1 r2",
            "group strong --where 'kind=Rover & battery>30'",
            "group cleaners --delete",
        ),
        guide=("robotree.vr.scripts.requirement",),
        alters=True,
    ),
    of_slot(
        "release PARENT.SLOT",
        "Release the child in a slot, or all of a group; it is listed as free again.",
        run="line.verbs:release",
        right="release",
        key="r",
        label="Release",
        danger=True,
        examples=("release mover.arm", "release team.rovers[1]"),
        alters=True,
    ),
    of_robot(
        "migrate NAME to HOST",
        "Have a virtual robot go on in another host: its commands go on there at their next step, and"
        " its children, its parent and its callers stay.",
        run="line.verbs:migrate",
        key="h",
        examples=("migrate tour to host-2",),
        alters=True,
    ),
    of_robot(
        "place NAME PLACEMENT",
        "Say how a virtual robot is moved. PLACEMENT: manual, by people alone; advise, it says where its"
        " calls would take less time; auto, it moves there by itself. `tree` marks it, `show` and `why`"
        " say the reason.",
        run="line.verbs:place",
        key="f",
        right="migrate",
        examples=("place tour auto", "place tour advise"),
        guide=("robotree.vr.core.placement",),
        alters=True,
    ),
    line(
        "drain HOST [--end]",
        "Have all robots of a host go on in the other hosts, those that carry something out first;"
        " --end: then end the host.",
        run="line.verbs:drain",
        examples=("drain host-1", "drain host-1 --end"),
        alters=True,
    ),
    of_robot(
        "delete NAME",
        "End a virtual robot; its children are released first.",
        run="line.verbs:delete",
        right="release",
        key="d",
        label="Delete",
        danger=True,
        examples=("delete teleop",),
        alters=True,
    ),
)
