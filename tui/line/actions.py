"""The one registry of what a person can do.

It feeds the keys and the footer, the help screen, the palette, the `:` prompt, the command line and the
session scripts. Whatever is not here cannot be done anywhere; whatever is here reads the same everywhere.
"""

from __future__ import annotations

from robotree.tui.line.action import ANYWHERE, LINES, SHOWN, About, Action, Scope, Where
from robotree.tui.line.grammar import Shape

RIGHT_NAMES = (
    "see",
    "command",
    "ask",
    "take",
    "order",
    "create",
    "release",
    "migrate",
    "resume",
    "administrate",
)
"""The rights of a policy (`vr/base/policy.py`, which help does not load; a test compares them)."""

LOOK, SHAPE, COMMAND, PROCESS, SCREEN = "Look", "Shape the tree", "Command", "Run", "Screen"
WIRE, SCRIPTS, AUTHOR = "Wire", "Scripts and roles", "Write a page"

ACTIONS: tuple[Action, ...] = (
    # -- look
    Action(
        usage="ls [--views | --hosts | --lookups]",
        help="List the free robots (enslaved ones: `tree`).",
        group=LOOK,
        run="ls",
        examples=("ls", "ls --views --json"),
    ),
    Action(
        usage="tree",
        help="Show the robots as trees: each below its parent, with its slot.",
        group=LOOK,
        run="tree",
        where=ANYWHERE,
        key="t",
    ),
    Action(
        usage="show NAME",
        help="Describe a robot: kinds, commands, slots, parent.",
        group=LOOK,
        right="see",
        run="show_or_remember",
        where=ANYWHERE,
        key="i",
        about=About.ROBOT,
        examples=("show arm-1",),
    ),
    Action(
        usage="groups [GROUP]",
        help="List the groups, or the members of one: who they are now, how, and why they are in it.",
        group=LOOK,
        run="groups",
        examples=("groups", "groups cleaners --json"),
    ),
    Action(
        usage="space ls [NAME] [KIND]",
        help="List the spaces, or what is in one: its entries, the oldest first, and its fences.",
        group=LOOK,
        run="space_ls",
        examples=("space ls", "space ls jobs", "space ls jobs Delivery --json"),
    ),
    Action(
        usage="stubs NAME [--out FILE]",
        help="Print the interface of a robot as Python, for `Child` in a page, which editors understand.",
        group=LOOK,
        right="see",
        run="stubs",
        writes=True,
        examples=("stubs arm-1", "stubs painter --out painter_kind.py"),
    ),
    Action(
        usage="look VIEW [FILE] [--camera CAMERA] [--size SIZE]",
        help="Fetch a picture of a workspace into a JPEG file.",
        group=LOOK,
        right="see",
        run="look",
        writes=True,
        examples=("look cell before.jpg --camera wrist --size 640x360",),
    ),
    Action(
        usage="watch [NAME] [--within TIME]",
        help="Print each change of state until it is interrupted.",
        group=LOOK,
        right="see",
        run="watch",
        where=Where.SHELL,
        examples=("watch arm-1 --json",),
    ),
    Action(
        usage="record FILE [NAME …] [--for TIME] [--pictures RATE]",
        help="Record a realm into FILE.mcap until Ctrl-C: states, readings, logs, who asked for what, and"
        " RATE pictures a second of each camera (2; 0: none). NAME: of these robots alone. Foxglove opens the"
        " file, too.",
        group=LOOK,
        right="see",
        run="recording.recorder:record",
        where=Where.SHELL,
        needs=("wire",),
        examples=("record monday.mcap", "record lever.mcap lever arm-1 --for 2min --pictures 5"),
    ),
    Action(
        usage="recording FILE [--at TIME]",
        help="Print what a recording holds, and its logs; --at: how each robot was, this long after the"
        " beginning.",
        group=LOOK,
        where=Where.SHELL,
        needs=("wire",),
        examples=("recording monday.mcap", "recording monday.mcap --at 12s"),
    ),
    Action(
        usage="recording compare FILE OTHER",
        help="Print where two recordings differ: commands are aligned by what was asked; of each, whether it"
        " ended otherwise, took longer, or left other readings.",
        group=LOOK,
        where=Where.SHELL,
        needs=("wire",),
        examples=("recording compare monday.mcap tuesday.mcap",),
    ),
    Action(
        usage="replay FILE [--from TIME] [--speed SPEED] [--beside OTHER]",
        help="Show a recording in the full screen: space holds it, left and right go back and forward by 5 s,"
        " with shift by 30 s, `[` and `]` make it slower and faster. Nothing in it can be commanded."
        " --beside: on top stands what was otherwise in OTHER at the command that ended last.",
        group=LOOK,
        where=Where.SHELL,
        needs=("wire", "tui"),
        examples=("replay monday.mcap --from 2min --speed 4",),
    ),
    Action(
        usage="foxglove [--port PORT] [--pictures RATE] [--look-only] [--for TIME]",
        help="Serve the realm to Foxglove until Ctrl-C, at an address of this machine (PORT, else 8765; 0: a"
        " free one) with a token: readings, logs, pictures, transforms, and the robots' commands as services,"
        " which end with the client that calls them. --look-only: without commands.",
        group=LOOK,
        run="recording.foxglove_server:foxglove",
        where=Where.SHELL,
        alters=True,
        needs=("wire", "foxglove"),
        examples=("foxglove", "foxglove --port 0 --look-only"),
        guide=("robotree.tui.recording.foxglove_server",),
    ),
    Action(
        usage="export session FILE [OUT]",
        help="Print what persons asked for in a recording as a session script, or write it into OUT:"
        " `robotree run` plays it again, and --junit makes a test of it.",
        group=LOOK,
        where=Where.SHELL,
        needs=("wire",),
        examples=("export session monday.mcap monday.session",),
    ),
    Action(
        usage="export lerobot FILE [OUT] [--fps NUMBER]",
        help="Write a recording as a LeRobot data set (version 3.0) into the new folder OUT: each command"
        " that a person asked for and that was done is an episode, with NUMBER (10) frames a second of all"
        " readings and pictures.",
        group=LOOK,
        where=Where.SHELL,
        needs=("wire", "lerobot"),
        examples=("export lerobot monday.mcap monday --fps 20",),
        guide=("robotree.tui.recording.lerobot",),
    ),
    Action(
        usage="export report FILE [OUT]",
        help="Write a recording as Markdown with pictures: who was there, what was asked, what was read.",
        group=LOOK,
        where=Where.SHELL,
        needs=("wire",),
        examples=("export report monday.mcap monday.md",),
    ),
    Action(
        usage="log [NAME] [--follow]",
        help="Print what the code of a robot says (print, warnings, logging), and its commands: who asked,"
        " how they ended, how long they waited and ran; --follow: go on until it is interrupted."
        " Without NAME: of all robots.",
        group=LOOK,
        right="see",
        run="log",
        where=ANYWHERE,
        key="g",
        examples=("log team", "log team --follow --json"),
    ),
    Action(
        usage="history NAME [--since WHEN] [--verify | --otel]",
        help="Print what a robot did, also before its host was started again: who asked, under which lease,"
        " how each command ended. --since: 10min, 14:30 or 2026-11-24T14:30. --verify: examine what is kept"
        " where the robot lives, and name the first event that is missing or changed. --otel: export its"
        " calls as spans of OpenTelemetry.",
        group=LOOK,
        right="see",
        run="history",
        where=ANYWHERE,
        key="H",
        about=About.ROBOT,
        examples=("history arm-1 --since 10min", "history team --verify"),
    ),
    Action(
        usage="why NAME|KEY",
        help="Print who asked for the last motion of a robot, or for the command of a key: each step with its"
        " lease, the line of the page and the times, up to the person at the top.",
        group=LOOK,
        right="see",
        run="why",
        where=ANYWHERE,
        key="W",
        about=About.ROBOT,
        examples=("why arm-1", "why arm-1 --json"),
    ),
    Action(
        usage="where NAME",
        help="Show where a robot is in its page: the line, the calls of its children with their results and"
        " times. On the screen it can be paused, stepped and continued there.",
        group=LOOK,
        right="see",
        run="line.standing:where",
        where=ANYWHERE,
        key="z",
        about=About.ROBOT,
        examples=("where lever", "where lever --json"),
    ),
    Action(
        usage="alarms",
        help="List the alarms, after a look at the readings: how each is, since when, who acknowledged it.",
        group=LOOK,
        run="line.alarming:alarms",
        examples=("alarms", "alarms --json"),
    ),
    Action(
        usage="alarm above ROBOT.READING LIMIT",
        help="Raise an alarm when a reading is above a LIMIT: in its row, the log and by the bell of each"
        " screen of yours, until you acknowledge it. It is kept. Angles in degrees.",
        group=LOOK,
        right="see",
        run="line.alarming:alarm_above",
        alters=True,
        examples=("alarm above arm-1.fz 20",),
    ),
    Action(
        usage="alarm below ROBOT.READING LIMIT",
        help="Raise an alarm when a reading is below a LIMIT (`alarm above`).",
        group=LOOK,
        right="see",
        run="line.alarming:alarm_below",
        alters=True,
        examples=("alarm below rover-1.battery 30",),
    ),
    Action(
        usage="alarm ack [ROBOT.READING]",
        help="Acknowledge an alarm, or all: you have seen it.",
        group=LOOK,
        run="line.alarming:alarm_ack",
        alters=True,
        examples=("alarm ack arm-1.fz", "alarm ack"),
    ),
    Action(
        usage="alarm clear ROBOT.READING",
        help="Take an alarm away.",
        group=LOOK,
        run="line.alarming:alarm_clear",
        alters=True,
        examples=("alarm clear arm-1.fz",),
    ),
    Action(
        usage="info",
        help="Print versions, paths, what the terminal can, and the realm.",
        group=LOOK,
        where=Where.SHELL,
        examples=("info", "info --json"),
    ),
    Action(
        usage="doctor [NAME]",
        help="Check why a robot is not seen: prints each result and what to do.",
        group=LOOK,
        where=Where.SHELL,
        examples=("doctor", "doctor arm-1"),
    ),
    Action(
        usage="completion SHELL [WORD …]",
        help="Print the script that completes lines of robotree in bash, zsh or fish; with words behind `--`:"
        " what the last of them may become.",
        group=LOOK,
        where=Where.SHELL,
        examples=("completion bash", "completion bash -- call arm-1."),
        guide=("robotree.tui.line.shells",),
    ),
    Action(
        usage="man",
        help="Print the manual page of all verbs; `robotree man | man -l -` shows it.",
        group=LOOK,
        where=Where.SHELL,
        examples=("man",),
    ),
    # -- write a page
    Action(
        usage="new [NAME] [--over KIND | --from PAGE]",
        help="Write a page NAME.py, its test and settings for an editor into this folder, on top of a KIND"
        " of robotree.kinds: arm, rover, limb, head, base and others; or begin with a PAGE of an installed"
        " package, or a file. Nothing is overwritten. Without NAME: list the pages that packages offer.",
        group=AUTHOR,
        where=Where.SHELL,
        examples=("new", "new team --over arm", "new night --from patrol"),
    ),
    Action(
        usage="compose [NAME] [--from FILE] [--of ROBOT …] [--tolerance LENGTH] [--untried] [--force]",
        help="Make a virtual robot without writing code: a page NAME.py, its panel and its test. FILE: what"
        " was shown once and recorded (`record`, FILE.mcap; --of: what these robots did, else what persons"
        " asked), a FILE.session, or steps as text. Ways are simplified within LENGTH (10 mm). It is tried in"
        " a twin of the cell before anything is written, unless --untried; nothing is overwritten without"
        " --force. Without FILE: the page of the full screen, where one chooses steps or shows them by hand.",
        group=AUTHOR,
        run="recording.composed:compose",
        where=ANYWHERE,
        key="C",
        label="Compose",
        alters=True,
        examples=("compose", "compose cup --from cup.mcap", "compose cup --from cup.steps --force"),
        guide=("robotree.tui.composing.lines",),
    ),
    Action(
        usage="check FILE",
        help="Check a page and its panels without any robot: what it would lose, what blocks, what its"
        " children lack.",
        group=AUTHOR,
        where=Where.SHELL,
        examples=("check team.py", "check team.py --json"),
    ),
    Action(
        usage="bundle build FILE [--out OUT] [--key KEY] [--may LIST]",
        help="Make a bundle of a page, FILE.py or FILE.py:Class, or of a script: one file, signed, which can"
        " be mailed. --key: your private key of OpenSSH; else that of the realm, or ~/.ssh/id_ed25519."
        " --may: the commands that it may call, KIND.COMMAND,…; else what the page says or shows.",
        group=AUTHOR,
        where=Where.SHELL,
        needs=("machines",),
        examples=(
            "bundle build team.py",
            "bundle build team.py --may Arm.move,Rover.* --key ~/.ssh/id_ed25519",
        ),
    ),
    Action(
        usage="bundle verify FILE [--trust FILE] [--requirements POLICY] [--allow-packages LIST]",
        help="Check a bundle as a host of yours would: is it as it was signed, and would it run?",
        group=AUTHOR,
        where=Where.SHELL,
        needs=("machines",),
        examples=("bundle verify team.bundle",),
    ),
    Action(
        usage="bundle sign FILE [--out OUT] [--key KEY]",
        help="Sign a bundle anew: you answer for it from then on, and not who has signed it before.",
        group=AUTHOR,
        where=Where.SHELL,
        needs=("machines",),
        examples=("bundle sign team.bundle --out ours.bundle",),
    ),
    Action(
        usage="bundle trust [KEY …] [--name WHO] [--may LIST] [--isolation LEVEL] [--authority] [--replace]"
        " [--revoke] [--trust FILE]",
        help="Let hosts of yours run what the owner of a KEY has signed; a KEY is `ssh-ed25519 AAAA…`, its"
        " file, or a bundle. --may: what it may call at most, KIND.COMMAND,…. --isolation: how it runs at"
        " least: none, process, sandbox. --authority: the key is that of a realm, and its members whose"
        " names fit WHO are meant, such as *@plant. --replace: the key has another line already, which goes."
        " --revoke: end that for ever. Without KEY: list them.",
        group=AUTHOR,
        where=Where.SHELL,
        alters=True,
        needs=("machines",),
        examples=(
            "bundle trust",
            "bundle trust anna.pub --name anna --may Arm.*,Rover.move",
            "bundle trust team.bundle --revoke",
        ),
        guide=("robotree.vr.bundle.trust",),
    ),
    Action(
        usage="bundle show FILE",
        help="Print what a bundle says of itself: its signer, what it needs, and what it may do.",
        group=AUTHOR,
        where=Where.SHELL,
        needs=("machines",),
        examples=("bundle show team.bundle", "bundle show team.bundle --json"),
    ),
    # -- shape the tree
    Action(
        usage="create FILE as NAME [on HOST] [PARAMETER=VALUE …] [--own-host | --isolate LEVEL] [--watch]",
        help="Make a virtual robot from FILE.py or FILE.py:Class, from a script, FILE.yaml or FILE.clp, or"
        " from a page that a package offers (`new` lists them); PARAMETER: one of its settings. --own-host:"
        " in a process of its own, NAME-host, which ends when it is deleted. --isolate process: in a process"
        " that its host makes for it, and that can harm nobody else. --watch (in a shell): go on, and reload"
        " it each time that the page or what belongs to it is saved.",
        group=SHAPE,
        right="create",
        run="create",
        where=ANYWHERE,
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
    Action(
        usage="service FILE NAME [on HOST] [PARAMETER=VALUE …]",
        help="Start a service: a page that watches robots and brings behaviours along, NAME-BEHAVIOUR."
        " Without HOST it has a process of its own, NAME-host; `delete NAME` takes the behaviours away, too.",
        group=SHAPE,
        right="create",
        run="service",
        where=LINES,
        examples=("service examples/services/greeter.py greeter",),
        alters=True,
    ),
    Action(
        usage="set NAME PARAMETER=VALUE …",
        help="Change settings of a robot, also while it works; while a parent commands it, only that may.",
        group=SHAPE,
        right="command",
        run="set_",
        where=ANYWHERE,
        key="s",
        about=About.ROBOT,
        examples=("set team speed=0.2", "set team speed='20 cm/s' label=left"),
        alters=True,
    ),
    Action(
        usage="reload NAME [FILE] [--now] [--watch]",
        help="Let a robot go on with its page as it is now, from the next boundary between commands on;"
        " --now cancels the running command. --watch (in a shell): again at each save, until Ctrl-C.",
        group=SHAPE,
        right="create",
        run="reload",
        where=ANYWHERE,
        key="u",
        about=About.ROBOT,
        examples=("reload team", "reload team team.py --now", "reload team --watch --json"),
        shell_options=("--watch",),
        alters=True,
    ),
    Action(
        usage="enslave PARENT.SLOT CHILD …",
        help="Put a virtual robot on top of another robot: fill its slot, or several of a group. With `where"
        " TEXT` instead of a CHILD it chooses one itself that is free: it is told why this one. A slot that"
        " only watches takes no lease: many may watch a robot, whoever commands it.",
        group=SHAPE,
        right="command",
        run="enslave",
        where=ANYWHERE,
        key="e",
        label="Enslave",
        about=About.SLOT,
        examples=(
            "enslave mover.arm arm-1",
            "enslave team.rovers rover-1 rover-2",
            "enslave watcher.seen arm-1",
            "enslave guide.rover where 'battery > 30 and near hall'",
        ),
        guide=("robotree.vr.scripts.requirement",),
        alters=True,
    ),
    Action(
        usage="group GROUP [ROBOT …] [--where TEXT] [--near PLACE] [--delete]",
        help="Give several robots one name: these ROBOTs, and all that fulfil TEXT, as `kind=Rover &"
        " battery>30`, or are at PLACE. `call`, `set`, `role`, `cancel`, `pause`, `continue`, `stop` and"
        " `resume` take the name of a group: one answer from each member.",
        group=SHAPE,
        run="group",
        examples=(
            "group cleaners r1 r2",
            "group strong --where 'kind=Rover & battery>30'",
            "group cleaners --delete",
        ),
        guide=("robotree.vr.scripts.requirement",),
        alters=True,
    ),
    Action(
        usage="release PARENT.SLOT",
        help="Release the child in a slot, or all of a group; it is listed as free again.",
        group=SHAPE,
        right="release",
        run="release",
        where=ANYWHERE,
        key="r",
        label="Release",
        about=About.SLOT,
        danger=True,
        examples=("release mover.arm", "release team.rovers[1]"),
        alters=True,
    ),
    Action(
        usage="migrate NAME to HOST",
        help="Have a virtual robot go on in another host: its commands go on there at their next step, and"
        " its children, its parent and its callers stay.",
        group=SHAPE,
        run="migrate",
        where=ANYWHERE,
        key="h",
        about=About.ROBOT,
        examples=("migrate tour to host-2",),
        alters=True,
    ),
    Action(
        usage="place NAME PLACEMENT",
        help="Say how a virtual robot is moved. PLACEMENT: manual, by people alone; advise, it says where its"
        " calls would take less time; auto, it moves there by itself. `tree` marks it, `show` and `why`"
        " say the reason.",
        group=SHAPE,
        run="place",
        where=ANYWHERE,
        key="f",
        about=About.ROBOT,
        right="migrate",
        examples=("place tour auto", "place tour advise"),
        guide=("robotree.vr.core.placement",),
        alters=True,
    ),
    Action(
        usage="drain HOST [--end]",
        help="Have all robots of a host go on in the other hosts, those that carry something out first;"
        " --end: then end the host.",
        group=SHAPE,
        run="drain",
        examples=("drain host-1", "drain host-1 --end"),
        alters=True,
    ),
    Action(
        usage="delete NAME",
        help="End a virtual robot; its children are released first.",
        group=SHAPE,
        right="release",
        run="delete",
        where=ANYWHERE,
        key="d",
        label="Delete",
        about=About.ROBOT,
        danger=True,
        examples=("delete teleop",),
        alters=True,
    ),
    # -- command
    Action(
        usage="go ROBOT PLACE|COORDINATE=VALUE … [--preview] [--within TIME]",
        help="Send a robot to a named place, `@shelf`, or to a point, x=0.3 y=0.1 z=0.2; what is not given"
        " stays as it is. The robot is asked first whether it would; --preview: only that, nothing moves.",
        group=COMMAND,
        right="command",
        run="line.going:go",
        where=ANYWHERE,
        key="G",
        about=About.ROBOT,
        alters=True,
        examples=("go arm-1 @shelf --preview", "go arm-1 @shelf", "go rover-1 x=0.5 y='-20 cm'"),
        guide=("robotree.tui.line.going",),
    ),
    Action(
        usage="places [ROBOT]",
        help="List the named places, or those that a robot can be sent to.",
        group=LOOK,
        right="see",
        run="line.going:places",
        examples=("places", "places arm-1 --json"),
    ),
    Action(
        usage="places add NEW of ROBOT [COORDINATE=VALUE …]",
        help="Name the point where a robot is now, or x, y, z, twist, heading in its frame. `@NEW` then"
        " stands for it wherever a command asks for a pose: `call arm-1.go_to @shelf`.",
        group=COMMAND,
        right="command",
        run="line.going:places_add",
        where=ANYWHERE,
        key="K",
        about=About.ROBOT,
        alters=True,
        examples=("places add shelf of arm-1", "places add dock of rover-1 x=0 y=0"),
        guide=("robotree.tui.line.going",),
    ),
    Action(
        usage="places remove PLACE",
        help="Forget a named place.",
        group=COMMAND,
        run="line.going:places_remove",
        alters=True,
        examples=("places remove shelf",),
    ),
    Action(
        usage="call ROBOT.COMMAND [PARAMETER=VALUE …] [--within TIME] [--detach | --queue | --save FILE]"
        " [--until WHEN] [--robot IDENTITY] [--trace]",
        help="Have a command carried out: progress on stderr, result on stdout. It ends with this program;"
        " with --detach it goes on by itself. --save: write the picture in its result into a file."
        " --queue: leave it as an order, which the robot carries out when it is there and free; --until:"
        " in which time it must begin, 2h or 18:00 (24h); --robot: which of several robots of this name that"
        " are away. --trace shows the way of a failure through the"
        " authors' pages.",
        group=COMMAND,
        right="command",
        run="call_or_leave",
        examples=(
            "call lever.close",
            "call mover.move x=0.4 y=0 z='30 cm' twist='90 deg' --within 30s",
            "call rover-1.move x=1 y=0 --queue --until 2h",
        ),
        alters=True,
    ),
    Action(
        usage="orders [NAME] [--mine] [--all]",
        help="List what is left for robots that are away or busy, and the results that wait. NAME: for one"
        " robot. --mine: only yours. --all: those, too, whose results have been taken.",
        group=COMMAND,
        right="see",
        run="orders",
        where=ANYWHERE,
        key="A",
        examples=("orders", "orders rover-1 --mine --json"),
    ),
    Action(
        usage="order show TICKET",
        help="Show one order: its arguments, its state, who has a copy of it.",
        group=COMMAND,
        right="see",
        run="order_show",
        where=LINES,
        examples=("order show 3fa2",),
    ),
    Action(
        usage="order cancel TICKET",
        help="End an order, also one that its robot carries out; names the directories that have not"
        " confirmed it.",
        group=COMMAND,
        right="order",
        run="order_cancel",
        where=LINES,
        examples=("order cancel 3fa2",),
        alters=True,
    ),
    Action(
        usage="order confirm TICKET",
        help="Let an order begin though its robot asks: somebody has commanded it since.",
        group=COMMAND,
        right="order",
        run="order_confirm",
        where=LINES,
        examples=("order confirm 3fa2",),
        alters=True,
    ),
    Action(
        usage="order settle TICKET OUTCOME",
        help="Say what became of an order in doubt, after a look at the robot: OUTCOME is done or undone.",
        group=COMMAND,
        right="order",
        run="order_settle",
        where=LINES,
        examples=("order settle 3fa2 undone",),
        alters=True,
    ),
    Action(
        usage="inbox [--keep]",
        help="Print the results of your orders, and take them out of the inbox; --keep: leave them there.",
        group=COMMAND,
        run="inbox",
        where=LINES,
        examples=("inbox", "inbox --keep --json"),
    ),
    Action(
        usage="take NAME … [--as DEVICE]",
        help="Put what is known of robots onto this machine: without any network `call --queue`, `orders`,"
        " `order show`, `order cancel`, `show` and `ls` work then, and orders are left at the next contact."
        " DEVICE: a name of this machine, whose orders have an inbox of their own.",
        group=COMMAND,
        right="order",
        run="take",
        where=Where.SHELL,
        examples=("take rover-1 arm-1", "take rover-1 --as notebook"),
    ),
    Action(
        usage="cancel NAME",
        help="End the commands of a robot, running and waiting.",
        group=COMMAND,
        right="command",
        run="cancel",
        where=ANYWHERE,
        key="c",
        about=About.ROBOT,
        examples=("cancel mover",),
        alters=True,
    ),
    Action(
        usage="pause NAME",
        help="Have a virtual robot, and those below it, wait before each step; new commands wait, too."
        " What moves now ends by itself; deadlines go on.",
        group=COMMAND,
        right="command",
        run="pause",
        where=ANYWHERE,
        key="b",
        about=About.ROBOT,
        examples=("pause mover",),
        alters=True,
    ),
    Action(
        usage="step NAME",
        help="Let one step of a paused robot pass, of its own or of a robot below it.",
        group=COMMAND,
        right="command",
        run="step",
        where=ANYWHERE,
        key="greater_than_sign",
        about=About.ROBOT,
        examples=("step mover",),
        alters=True,
    ),
    Action(
        usage="continue NAME",
        help="End the pause of a robot and of those below it.",
        group=COMMAND,
        right="command",
        run="continue_",
        where=ANYWHERE,
        key="B",
        about=About.ROBOT,
        examples=("continue mover",),
        alters=True,
    ),
    Action(
        usage="questions",
        help="List what scripts ask people, and commands that ask after a crash, with their answers.",
        group=COMMAND,
        right="see",
        run="line.questions:questions",
        examples=("questions", "questions --json"),
    ),
    Action(
        usage="decide NAME ANSWER [--question ID]",
        help="Answer what a script asks, or a command that asks after a crash: it is done, goes on"
        " (again), or ends (abort). --question: only if it is still this one.",
        group=COMMAND,
        right="command",
        run="decide",
        where=LINES,
        examples=("decide mover again", "decide guide yes"),
        alters=True,
    ),
    Action(
        usage="stop [NAME] [--everywhere]",
        help="Protective stop of one robot, or of everything, now; --everywhere: in all your realms.",
        shell_options=("--everywhere",),
        group=COMMAND,
        right="stop",
        run="stop",
        where=ANYWHERE,
        key="space",
        typing_key="ctrl+s",
        scope=Scope.PROGRAM,
        while_busy=True,
        examples=("stop", "stop arm-1", "stop --everywhere"),
    ),
    Action(
        usage="resume [NAME]",
        help="Resume after a protective stop; nothing moves by itself.",
        group=COMMAND,
        right="resume",
        run="resume",
        where=ANYWHERE,
        key="R",
        scope=Scope.PROGRAM,
        danger=True,
        examples=("resume",),
        alters=True,
    ),
    # -- several operators
    Action(
        usage="who",
        help="List the operators who are here, on which page, and who has control of which robots.",
        group=LOOK,
        run="line.operators:who",
        where=ANYWHERE,
        key="6",
        examples=("who", "who --json"),
    ),
    Action(
        usage="say TEXT …",
        help="Say a line to all operators: their logs show it.",
        group=LOOK,
        run="line.operators:say",
        where=ANYWHERE,
        key="7",
        examples=("say 'I leave for lunch'",),
    ),
    Action(
        usage="control get NAME [--for TIME]",
        help="Get control of a robot that nobody has, or that is offered to you: nobody else moves it then."
        " It lasts as long as this program, from a shell 10 min (--for).",
        group=COMMAND,
        right="command",
        run="line.operators:control_get",
        where=ANYWHERE,
        key="1",
        about=About.ROBOT,
        examples=("control get arm-1", "control get arm-1 --for 1h"),
        guide=("robotree.vr.core.control",),
        alters=True,
    ),
    Action(
        usage="control ask NAME [--for TIME]",
        help="Ask the operator who has control of a robot for it; the question stays open for 30 s.",
        group=COMMAND,
        right="command",
        run="line.operators:control_ask",
        where=ANYWHERE,
        key="2",
        about=About.ROBOT,
        examples=("control ask arm-1",),
        alters=True,
    ),
    Action(
        usage="control offer NAME [PERSON]",
        help="Hand control of a robot over to who asks for it, or offer it to a PERSON for 30 s.",
        group=COMMAND,
        right="command",
        run="line.operators:control_offer",
        where=ANYWHERE,
        key="3",
        about=About.ROBOT,
        examples=("control offer arm-1", "control offer arm-1 ben@pts/4"),
        alters=True,
    ),
    Action(
        usage="control take NAME [--for TIME] [--seen N]",
        help="Take control of a robot from the operator who has it, and end what that one has begun."
        " --seen: only if it has changed hands N times so far.",
        group=COMMAND,
        right="take",
        run="line.operators:control_take",
        where=ANYWHERE,
        key="4",
        about=About.ROBOT,
        danger=True,
        examples=("control take arm-1",),
        alters=True,
    ),
    Action(
        usage="control leave NAME",
        help="Give control of a robot up, or take back the question for it.",
        group=COMMAND,
        run="line.operators:control_leave",
        where=ANYWHERE,
        key="5",
        about=About.ROBOT,
        examples=("control leave arm-1",),
        alters=True,
    ),
    # -- scripts and roles
    Action(
        usage="role NAME ROLE",
        help="Let a robot play a role from its next act on; ROLE: a name, or FILE.yaml with yours.",
        group=SCRIPTS,
        right="command",
        run="role",
        where=ANYWHERE,
        key="p",
        about=About.ROBOT,
        examples=("role companion child", "role companion waiter.yaml"),
        alters=True,
    ),
    Action(
        usage="rules check FILE [--listing]",
        help="Check a script (FILE.yaml or FILE.clp); --listing: print the rules that it became.",
        group=SCRIPTS,
        where=Where.SHELL,
        needs=("scripts",),
        examples=("rules check examples/guide.yaml", "rules check guide.yaml --listing"),
    ),
    Action(
        usage="rules test TABLE",
        help="Play a table of events against a script, without any robot, and compare the orders.",
        group=SCRIPTS,
        where=Where.SHELL,
        needs=("scripts",),
        examples=("rules test examples/guide.test.yaml",),
        guide=("robotree.vr.scripts.trial",),
    ),
    Action(
        usage="rules dry-run FILE [TABLE]",
        help="Show what a script would do at the events of a TABLE, or of standard input, one per line.",
        group=SCRIPTS,
        where=Where.SHELL,
        needs=("scripts",),
        examples=("rules dry-run examples/guide.yaml", "rules dry-run guide.yaml guide.test.yaml"),
        guide=("robotree.vr.scripts.trial",),
    ),
    Action(
        usage="rules explain WHAT [RULE] [--after TABLE]",
        help="Explain why a RULE fired or not, in a FILE or running script; without RULE: facts and agenda.",
        group=SCRIPTS,
        run="explain",
        where=LINES,
        examples=("rules explain guide greet", "rules explain guide.yaml greet --after guide.test.yaml"),
    ),
    # -- run
    Action(
        usage="demo [STORY] [--crash] [--headless] [--pictures FOLDER] [--can] [--classic] [--speedup FACTOR]"
        " [--delay MS] [--key FILE | --open]",
        help="A whole cell: simulated robots, proxies, lookups, a host, the full screen; --can: over CAN FD."
        " STORY: companion, a flat with visitors instead of the cell; sites, a lever that is closed from"
        " another site, --delay milliseconds away (150), while the hub between them is killed; travel, the"
        " same by robots near the operator, near the arm, moved in between, and left to themselves; away, a"
        " rover that is switched off and takes its orders when it is back; mcp, an assistant that closes the"
        " lever when you say yes; compose, a cup is carried once by hand, and again by the page made of that."
        " --crash: close the lever, kill the host of its robots meanwhile, and see them go on."
        " Its links are signed with the realm's own key, with --open they are not. --speedup: as for sim.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("sim",),
        examples=(
            "demo --can",
            "demo --crash",
            "demo companion --headless",
            "demo sites --headless --delay 150",
            "demo travel --headless --delay 150",
            "demo away --headless",
            "demo mcp --headless",
            "demo compose --headless",
            "demo --headless --can --classic",
        ),
    ),
    Action(
        usage="supervise",
        help="The full screen over the robots of this realm.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("tui",),
    ),
    Action(
        usage="user",
        help="The page for people who do not operate robots: what robots can do, in plain words; begin it,"
        " watch it, order it for later, answer questions, take results, choose a role, write a script."
        " 40 by 20 characters are enough; without a network it shows what was taken along.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("tui",),
        examples=("user",),
    ),
    Action(
        usage="web [--listen ADDRESS] [--cert FILE] [--origin ORIGIN] [--tabs N]",
        help="Serve the full screen to browsers at a port of this machine (7334), and print the addresses:"
        " one to command, one to watch. Each tab has its own screen; what that has begun ends when the"
        " tab closes."
        " ADDRESS: another port, or HOST:PORT, which needs --cert, a certificate with its key. ORIGIN: of a"
        " proxy in front of it, such as https://robots.example. --tabs: as many at most (8).",
        group=PROCESS,
        where=Where.SHELL,
        needs=("tui", "web"),
        examples=("web", "web --listen 8080 --readonly"),
        guide=("robotree.tui.web.door",),
    ),
    Action(
        usage="restart NAME",
        help="Start a proxy, a host or another agent again whose process has gone: by systemd where it is a"
        " service of yours, else as `apply` started it.",
        group=PROCESS,
        run="line.restarting:restart",
        where=ANYWHERE,
        key="X",
        about=About.ROBOT,
        alters=True,
        examples=("restart arm-1", "restart host-1"),
    ),
    Action(
        usage="run FILE [--junit FILE]",
        help="Play a script of verbs and `expect CONDITION within TIME` (- for standard input);"
        " --junit: write the steps as a JUnit report, too.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("run examples/close_lever.session", "run -", "run trial.session --junit trial.xml"),
        guide=("robotree.tui.session.script", "robotree.tui.session.conditions"),
    ),
    Action(
        usage="test [PATH …] [--select EXPRESSION] [--exitfirst] [--junit FILE] [--collect-only]",
        help="Play the trials of FOLDERs and FILEs (*.session) as a test suite; FILE::NAME is one of them."
        " -k (--select): only those whose names fit, such as `lift and not slow`; -x (--exitfirst): end at"
        " the first that fails. The exit code is 0 if all held, 1 if one did not, 2 for Ctrl-C or a line that"
        " cannot be understood, 5 if there was none.",
        group=PROCESS,
        where=Where.SHELL,
        examples=(
            "test examples/trials",
            "test examples/trials -k 'lift and not drill' -x",
            "test 'examples/trials/lift.session::there and back' --junit trials.xml",
        ),
        guide=("robotree.tui.session.script", "robotree.tui.session.conditions"),
    ),
    Action(
        usage="fault cut ROBOT [--for TIME]",
        help="For a drill, let nothing cross the link between a robot's proxy and its controller, for a TIME"
        " or until the session ends.",
        group=PROCESS,
        run="session.faults:fault_cut",
        alters=True,
        right="command",
        examples=("fault cut arm-1 --for 3s",),
        guide=("robotree.tui.session.faults",),
    ),
    Action(
        usage="fault delay ROBOT TIME [--for TIME]",
        help="For a drill, let everything on a robot's link take a TIME longer, each way.",
        group=PROCESS,
        run="session.faults:fault_delay",
        alters=True,
        right="command",
        examples=("fault delay arm-1 200ms --for 10s",),
    ),
    Action(
        usage="fault freeze NAME [--for TIME]",
        help="For a drill, stop the process of a robot, host or lookup of yours on this machine, and continue"
        " it in the end.",
        group=PROCESS,
        run="session.faults:fault_freeze",
        alters=True,
        examples=("fault freeze host-1 --for 2s",),
    ),
    Action(
        usage="fault kill NAME",
        help="For a drill, kill the process of a robot, host or lookup of yours on this machine; only what"
        " keeps it (the demo, systemd) starts it again.",
        group=PROCESS,
        run="session.faults:fault_kill",
        alters=True,
        examples=("fault kill host-1",),
    ),
    Action(
        usage="fault end",
        help="End all faults that were begun from here.",
        group=PROCESS,
        run="session.faults:fault_end",
        where=Where.PROMPT | Where.SCRIPT,
        alters=True,
        examples=("fault end",),
    ),
    Action(
        usage="sim KIND --listen URL [--key FILE | --open] [--state FILE] [--reset-epoch] [--speedup FACTOR]"
        " [--log FILE]",
        help="Simulate a robot's controller; every program can command it unless it has a key"
        " (`realm`: the realm's). --reset-epoch: forget the leases that it has accepted."
        " --log: write each goal that it begins and ends into a file, with its key."
        " --speedup: simulated seconds in a second, up to 10.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("sim",),
        examples=("sim arm --listen tcp:127.0.0.1:5760",),
    ),
    Action(
        usage="proxy KIND NAME --connect URL [--component N] [--key FILE | --open] [--take-over]",
        help="Connect a robot's controller to the realm; KIND: arm, rover, limb, head, base, or"
        " FILE.py with yours. --component: which MAVLink component of the controller it is (1)."
        " --take-over: also if another proxy holds it.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("proxy arm arm-1 --connect tcp:127.0.0.1:5760",),
    ),
    Action(
        usage="view NAME --connect URL [--cameras LIST] [--key FILE | --open]",
        help="Offer pictures of the workspace of a robot's controller."
        " --cameras: other cameras than cell=100,wrist=101.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("view cell --connect tcp:127.0.0.1:5760",),
    ),
    Action(
        usage="host NAME [--only ROBOT | --forget | --standby-for HOST] [--after TIME] [--journal URL]"
        " [--trust FILE] [--requirements POLICY] [--allow-packages LIST] [--insecure-any-signer]"
        " [--isolate LEVEL] [--most N]",
        help="Run virtual robots that are created, and keep them; --only: this one alone, until it ends."
        " --forget: begin without those that were kept, and keep none."
        " --standby-for: wait, and have the robots of HOST when it is away for TIME (3s). --journal: keep"
        " them in a PostgreSQL database that several machines can reach, instead of a folder of this one."
        " --trust: whose pages it runs beside your own (`help bundle trust`). --requirements: what it does"
        " with pages of others that need packages: refuse (as it does by itself), allowlist, locked;"
        " --allow-packages: names, for the allowlist. --insecure-any-signer: run what anybody has signed, or"
        " nobody; for a trial alone, and red on the screen. --isolate process: each robot in a process of"
        " its own. --most: run N robots at most.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("host host-1", "host host-2 --standby-for host-1 --after 5s"),
    ),
    Action(
        usage="lookup NAME",
        help="Run a lookup service; any number of them serve together.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("lookup lookup-1",),
    ),
    Action(
        usage="directory NAME [--store URL]",
        help="Run a lookup service with a durable memory: it remembers robots that are away, and keeps orders"
        " for them and their results. Several share what they have. URL: of a database (postgresql://…) that"
        " has the memory instead of a folder of this machine.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("directory directory-1",),
        guide=("robotree.vr.orders.service",),
    ),
    Action(
        usage="hub --listen ADDRESS [--print-config]",
        help="Run the router that the sites of a realm dial; it delivers, and can read nothing. It prints its"
        " address with the fingerprint of its certificate. ADDRESS: tls:HOST:PORT; tcp: only on loopback."
        " --print-config: print the configuration with which the official zenohd does the same.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("machines",),
        examples=("hub --listen tls:0.0.0.0:7447",),
    ),
    Action(
        usage="gateway",
        help="Link this machine to the other sites of the realm (--realm NAME), of which it must have a key.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("machines",),
        examples=("gateway --realm plant",),
    ),
    Action(
        usage="realm create NAME [--group GROUP] [--hub ADDRESS] [--site SITE]",
        help="Make a realm of several machines, with this one as its first SITE, and its authority here."
        " ADDRESS: as `robotree hub` printed it; of several, with commas, the first that answers is used."
        " --group: share the realm with the users of a GROUP of this machine instead, by its policy.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        examples=(
            "realm create plant --hub tls:hub.example:7447#FINGERPRINT --site lab",
            "realm create cell --group robots",
        ),
    ),
    Action(
        usage="realm invite NAME [--as KIND] [--may ROLES] [--days N]",
        help="Print a token with which a machine joins the realm under a NAME, once, within an hour. KIND:"
        " site, or person. --days: for which its key will be good (90).",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        needs=("machines",),
        examples=("realm invite hall --realm plant", "realm invite anna --as person --realm plant"),
    ),
    Action(
        usage="realm join TOKEN",
        help="Make a key on this machine, which never leaves it, and have it signed with a TOKEN."
        " TOKEN: from `realm invite`; NAME@USER for a realm that another user of this machine shares.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        examples=("realm join TOKEN", "realm join cell@anna"),
    ),
    Action(
        usage="realm members",
        help="List the members of the realm, and how long their keys are good.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("machines",),
        examples=("realm members --realm plant",),
    ),
    Action(
        usage="realm revoke NAME",
        help="End the key of a member now, where the realm was made.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        needs=("machines",),
        examples=("realm revoke anna --realm plant",),
    ),
    Action(
        usage="realm renew [--days N]",
        help="Have the key of this machine signed again.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        needs=("machines",),
        examples=("realm renew --realm plant",),
    ),
    Action(
        usage="realm export",
        help="Print what everybody may know of the realm; no key is in it.",
        group=PROCESS,
        where=Where.SHELL,
        needs=("machines",),
        examples=("realm export --realm plant",),
    ),
    Action(
        usage="may PERSON VERB TARGET",
        help="Explain whether a PERSON may do something, with the line of the policy that decides. VERB: a"
        f" right ({', '.join(RIGHT_NAMES)}), or a verb that needs one."
        " TARGET: a robot, ROBOT.COMMAND, or a host. PERSON may be mcp/NAME: an assistant.",
        group=LOOK,
        run="may",
        examples=("may anna command arm-1.move_to", "may ben@hall create host-1 --json"),
    ),
    Action(
        usage="policy show [--schema]",
        help="Print the policy of the realm; --schema: the JSON schema of the file, for editors.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("policy show --realm plant", "policy show --schema"),
    ),
    Action(
        usage="policy check FILE",
        help="Check a policy, and print what each of its lines allows with the robots that are there now.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("policy check plant.yaml",),
    ),
    Action(
        usage="policy set FILE",
        help="Put a policy in force within a second; in a realm with keys, where its authority is, then at"
        " each site. Its version must be higher than that of the last one.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        examples=("policy set plant.yaml --realm plant",),
        guide=("robotree.vr.base.policy",),
    ),
    Action(
        usage="permits [--all]",
        help="List the calls of assistants that wait for a person's yes: who wants what, why, and what it"
        " would do. --all: also those that were answered.",
        group=COMMAND,
        run="line.permits:permits",
        where=ANYWHERE,
        key="P",
        examples=("permits", "permits --all --json"),
    ),
    Action(
        usage="permit allow PERMIT",
        help="Say yes to one call of an assistant: it may begin once, within 5 minutes, if the robot is still"
        " as it was and was not stopped since.",
        group=COMMAND,
        run="line.permits:permit_allow",
        alters=True,
        right="command",
        examples=("permit allow k7q2w9xa",),
        guide=("robotree.vr.base.permit",),
    ),
    Action(
        usage="permit deny PERMIT",
        help="Say no to a call of an assistant, or take back a yes that was not used.",
        group=COMMAND,
        run="line.permits:permit_deny",
        alters=True,
        examples=("permit deny k7q2w9xa",),
    ),
    Action(
        usage="mcp [--robots PATTERN] [--http PORT] [--rehearse] [--cell FILE]",
        help="Serve the robots to a language model by the Model Context Protocol, over stdio with the key"
        " in $ROBOTREE_MCP_KEY, or at a PORT of loopback with keys as bearer tokens. --rehearse: over a"
        " simulated twin of the realm (of a realm FILE with --cell), where nothing real moves.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        needs=("mcp",),
        examples=("mcp --robots 'arm-*'", "mcp --http 7333", "mcp --rehearse"),
        guide=("robotree.assistants",),
    ),
    Action(
        usage="assistants [NAME]",
        help="List the assistants that have keys, and their roles; of one, what it asked for lately and what"
        " became of it.",
        group=LOOK,
        where=Where.SHELL,
        examples=("assistants", "assistants claude --json"),
    ),
    Action(
        usage="assistant invite NAME",
        help="Make the key of an assistant and print it, once; what it may do says the policy.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        examples=("assistant invite claude",),
    ),
    Action(
        usage="assistant revoke NAME",
        help="Take the key of an assistant back.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        examples=("assistant revoke claude",),
    ),
    Action(
        usage="save FILE [--force]",
        help="Write the realm into a FILE that people can read and edit: its processes, robots, pages,"
        " settings, roles and bonds. --force: replace a FILE that is there.",
        group=PROCESS,
        where=Where.SHELL,
        examples=("save cell.yaml", "save cell.yaml --force"),
    ),
    Action(
        usage="apply FILE [--dry-run] [--prune] [--yes]",
        help="Start and bind what is in a FILE and not in the realm, and print each step. What the file does"
        " not name stays; --prune ends it, after a question (--yes: without one). --dry-run: only print.",
        group=PROCESS,
        where=Where.SHELL,
        alters=True,
        examples=("apply cell.yaml --dry-run", "apply cell.yaml", "apply cell.yaml --prune --yes --json"),
        guide=("robotree.tui.realm_file.reading",),
    ),
    Action(
        usage="space serve NAME [--store STORE] [--durability CLASS]",
        help="Run the space in which robots write, read and take entries. STORE: a SQLite file (without it:"
        " one in the folder of the realm's state), the URL of a PostgreSQL database, or `memory`. CLASS, what"
        " an answered request survives: `process`, any kill, or `power`, loss of power.",
        group=PROCESS,
        where=Where.SHELL,
        examples=(
            "space serve jobs",
            "space serve jobs --durability power",
            "space serve jobs --store postgresql://db.local/robots",
        ),
    ),
    # -- the wire (`tui/wire`)
    Action(
        usage="wire decode FILE [--as FORMAT] [--xml DIALECT]",
        help="Print the MAVLink frames in a recording, a candump log or raw bytes (- for standard input).",
        group=WIRE,
        where=Where.SHELL,
        examples=("wire decode flight.tlog", "wire decode - --json"),
    ),
    Action(
        usage="wire record --connect URL FILE [--for TIME] [--key FILE] [--xml DIALECT]",
        help="Record the frames of a link in a FILE.tlog, or FILE.mcap for Foxglove.",
        group=WIRE,
        where=Where.SHELL,
        examples=(
            "wire record --connect tcp:127.0.0.1:5760 arm.tlog --for 10s",
            "wire record --connect tcp:127.0.0.1:5771 crane.mcap --xml crane.xml",
        ),
    ),
    Action(
        usage="wire replay FILE --connect URL | --listen URL [--speed SPEED] [--commands] [--key FILE]",
        help="Send a recording again at its own speed, SPEED times as fast, or as fast as possible (max);"
        " with --connect frames that command are left out unless --commands is given.",
        group=WIRE,
        where=Where.SHELL,
        examples=(
            "wire replay arm.tlog --listen tcp:127.0.0.1:5770",
            "wire replay arm.tlog --connect tcp:5780",
        ),
        alters=True,
    ),
    Action(
        usage="wire monitor --connect URL [URL …] [--for TIME] [--every TIME] [--key FILE] [--xml DIALECT]",
        help="Watch links: rate, age and last value of each message; loss, delay and bytes per second.",
        group=WIRE,
        where=Where.SHELL,
        examples=("wire monitor --connect tcp:127.0.0.1:5760",),
    ),
    Action(
        usage="wire ping --connect URL [--count COUNT] [--every TIME] [--for TIME] [--by SERVICE]"
        " [--key FILE]",
        help="Measure how long a frame takes there and back, by PING (or by timesync).",
        group=WIRE,
        where=Where.SHELL,
        examples=("wire ping --connect tcp:127.0.0.1:5760 --count 100 --every 10ms",),
    ),
    Action(
        usage="wire conform --connect URL [RULE …] [--kind KIND] [--component N] [--key FILE]",
        help="Try whether a controller keeps the rules of docs/bring-your-own-robot.md; its robot moves."
        " KIND: arm, rover, base, limb or head; without it, what the telemetry shows. RULE: only these.",
        group=WIRE,
        where=Where.SHELL,
        examples=(
            "wire conform --connect tcp:127.0.0.1:5761",
            "wire conform --connect tcp:127.0.0.1:5761 key-repeat silence --json",
        ),
        alters=True,
    ),
    Action(
        usage="wire dissector [FILE] [--port PORT] [--xml DIALECT]",
        help="Write a Lua file with which Wireshark and tshark decode the frames.",
        group=WIRE,
        where=Where.SHELL,
        needs=("wire",),
        examples=("wire dissector robotree.lua",),
    ),
    Action(
        usage="wire dialect --lang LANGUAGE OUT [--xml DIALECT] [--include BASE]",
        help="Write our dialect, or yours, in c, c++, csharp, java, objc, python, swift, wireshark, or xml.",
        group=WIRE,
        where=Where.SHELL,
        needs=("wire",),
        examples=(
            "wire dialect --lang c include/mavlink",
            "wire dialect --lang c mine --xml mine.xml",
            "wire dialect --lang python robotree.py --include ardupilotmega",
        ),
    ),
    Action(
        usage="wire inject --listen URL --connect URL [--loss SHARE] [--delay TIME] [--jitter TIME]"
        " [--duplication SHARE] [--seed NUMBER] [--for TIME]",
        help="Relay between two programs as a bad link would; lines on standard input (cut 3s) change it.",
        group=WIRE,
        where=Where.SHELL,
        guide=("robotree.tui.wire.inject",),
        examples=(
            "wire inject --listen tcp:127.0.0.1:5770 --connect tcp:127.0.0.1:5760 --loss 20% --delay 50ms",
        ),
        alters=True,
    ),
    Action(
        usage="wire key FILE [--links PATTERN] [--passphrase] [--of CONTROLLER]",
        help="Make a file with a signing key for --key FILE, or for $ROBOTREE_KEY."
        " --of: print the key that one controller, named by its address, gets from a file (or `realm`).",
        group=WIRE,
        where=Where.SHELL,
        examples=(
            "wire key cell.key",
            "wire key cell.key --links 'tcp:127.0.0.1:*' --passphrase",
            "wire key realm --of tcp:127.0.0.1:5760",
        ),
    ),
    Action(
        usage="wire bench [PART …]",
        help="Measure the speed of codec and links as ratios: codec, trips, noise, imports, clients.",
        group=WIRE,
        where=Where.SHELL,
        needs=("wire",),
        examples=("wire bench", "wire bench codec trips"),
    ),
    # -- the screen alone
    Action(
        "panel",
        "Open the panel of the selected robot: a form for each command.",
        SCREEN,
        where=Where.SCREEN,
        key="enter",
        label="Panel",
        about=About.SLOT,
        alters=True,
    ),
    Action("robots", "Go back to the list of robots.", SCREEN, where=SHOWN, key="l"),
    Action(
        "sort",
        "Sort the robots in the next way: problems first, then by name, kind, state, by, host.",
        SCREEN,
        where=SHOWN,
        key="S",
    ),
    Action(
        "divide",
        "Divide the list of robots into parts: by site, kind or state, or not at all.",
        SCREEN,
        where=SHOWN,
        key="I",
    ),
    Action("larger", "Give more of the page to what is below the list.", SCREEN, where=SHOWN, key="plus"),
    Action("smaller", "Give less of the page to what is below the list.", SCREEN, where=SHOWN, key="minus"),
    Action(
        "view next",
        "Use the next saved filter; after the last one show all robots.",
        SCREEN,
        where=SHOWN,
        key="N",
    ),
    Action(
        "view use NAME",
        "Filter the list by what was saved under a NAME; `:view NAME` does the same.",
        SCREEN,
        where=Where.PROMPT,
    ),
    Action(
        "view save NAME",
        "Save the present filter of the list of robots under a NAME; it is kept for you.",
        SCREEN,
        where=Where.PROMPT,
    ),
    Action("view drop NAME", "Forget a saved filter.", SCREEN, where=Where.PROMPT),
    Action(
        "wide",
        "Give the whole page to the list, with more columns (epoch, lease, process), and back.",
        SCREEN,
        where=SHOWN,
        key="w",
    ),
    Action(
        "joints",
        "Show each joint of the selected robot in its own line, and back.",
        SCREEN,
        where=SHOWN,
        key="J",
    ),
    Action(
        "mark",
        "Mark the selected robot, or remove its mark: cancel and delete apply to all marked robots.",
        SCREEN,
        where=Where.SCREEN,
        key="m",
        about=About.ROBOT,
    ),
    Action(
        "theme [NAME]",
        "Show the screen in other colours: those of NAME, or the next ones; dark, light, colour-blind, and"
        " your files.",
        SCREEN,
        where=SHOWN,
        key="f8",
        examples=("theme light",),
    ),
    Action(
        "language [LANGUAGE]",
        "Show the words of the screen in another LANGUAGE, or the next one: en, de, ar. Verbs stay as they"
        " are.",
        SCREEN,
        where=SHOWN,
        key="f9",
        examples=("language de",),
    ),
    Action("unmark", "Remove all marks.", SCREEN, where=SHOWN, key="M"),
    Action(
        "dismiss",
        "Remove a robot that hangs or has gone from the list; it returns when it answers.",
        SCREEN,
        where=Where.SCREEN,
        key="D",
        about=About.ROBOT,
    ),
    Action(
        "plan",
        "Show the place of the selected robot from above: robots, named places, the way to the cursor.",
        SCREEN,
        where=SHOWN,
        key="F",
    ),
    Action(
        "readings",
        "Show readings over time: tick those of the selected robot, look back, and set alarms.",
        SCREEN,
        where=SHOWN,
        key="U",
    ),
    Action(
        "messages",
        "Show the messages on the wire of a proxy: rate, age, fields; a ticked field is drawn over time.",
        SCREEN,
        where=Where.SCREEN,
        key="Q",
        about=About.ROBOT,
    ),
    Action("views", "Show pictures of the workspaces.", SCREEN, where=SHOWN, key="v"),
    Action(
        "level",
        "Change the level of the log: all, warnings and errors, errors only.",
        SCREEN,
        where=SHOWN,
        key="L",
    ),
    Action("together", "Show all cameras side by side, and back.", SCREEN, where=SHOWN, key="Y"),
    Action(
        "skeleton",
        "Show the arm of a view as a skeleton, by its joints, for lines too thin for pictures, and back.",
        SCREEN,
        where=SHOWN,
        key="y",
    ),
    Action("camera", "Show the picture of the next camera.", SCREEN, where=SHOWN, key="V"),
    Action(
        "filter",
        "Show only rows that contain these letters.",
        SCREEN,
        where=Where.SCREEN,
        key="slash",
        label="Filter",
    ),
    Action(
        "prompt",
        "Type a verb.",
        SCREEN,
        where=Where.SCREEN,
        key="colon",
        scope=Scope.PROGRAM,
        while_busy=True,
        label="Verb",
    ),
    Action(
        "help",
        "Show all keys and verbs.",
        SCREEN,
        where=SHOWN | Where.SHELL,
        key="question_mark",
        typing_key="f1",
        scope=Scope.PROGRAM,
        label="Help",
    ),
    Action("quit", "Leave; the robots stay as they are.", SCREEN, where=SHOWN, key="q", label="Quit"),
)

BY_VERB = {action.verb: action for action in ACTIONS}


def shapes(where: Where) -> dict[str, Shape]:
    """Return the verbs of a kind of surface; `Surface` knows what is absent there now."""
    return {action.verb: action.shape for action in ACTIONS if where in action.where}
