"""Who may do what: policies, and language models as operators that ask."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, COMMAND, LOOK, PROCESS, RIGHT_NAMES, Action, Where

shell = partial(Action, group=PROCESS, where=Where.SHELL)
line = partial(Action, group=COMMAND)

VERBS = (
    Action(
        "may PERSON VERB TARGET",
        "Explain whether a PERSON may do something, with the line of the policy that decides. VERB: a"
        f" right ({', '.join(RIGHT_NAMES)}), or a verb that needs one."
        " TARGET: a robot, ROBOT.COMMAND, or a host. PERSON may be mcp/NAME: an assistant.",
        group=LOOK,
        run="line.verbs:may",
        examples=("may anna command arm-1.move_to", "may ben@hall create host-1 --json"),
    ),
    shell(
        "policy show [--schema]",
        "Print the policy of the realm; --schema: the JSON schema of the file, for editors.",
        start="sites.policies:show",
        examples=("policy show --realm plant", "policy show --schema"),
    ),
    shell(
        "policy check FILE",
        "Check a policy, and print what each of its lines allows with the robots that are there now.",
        start="sites.policies:check",
        examples=("policy check plant.yaml",),
    ),
    shell(
        "policy set FILE",
        "Put a policy in force within a second; in a realm with keys, where its authority is, then at"
        " each site. Its version must be higher than that of the last one.",
        start="sites.policies:set_",
        alters=True,
        examples=("policy set plant.yaml --realm plant",),
        guide=("robotree.vr.base.policy",),
    ),
    Action(
        "permits [--all]",
        "List the calls of assistants that wait for a person's yes: who wants what, why, and what it"
        " would do. --all: also those that were answered.",
        group=COMMAND,
        where=ANYWHERE,
        run="line.permits:permits",
        key="P",
        examples=("permits", "permits --all --json"),
    ),
    line(
        "permit allow PERMIT",
        "Say yes to one call of an assistant: it may begin once, within 5 minutes, if the robot is still"
        " as it was and was not stopped since.",
        run="line.permits:permit_allow",
        alters=True,
        right="command",
        examples=("permit allow k7q2w9xa",),
        guide=("robotree.vr.base.permit",),
    ),
    line(
        "permit deny PERMIT",
        "Say no to a call of an assistant, or take back a yes that was not used.",
        run="line.permits:permit_deny",
        alters=True,
        examples=("permit deny k7q2w9xa",),
    ),
    shell(
        "mcp [--robots PATTERN] [--http PORT] [--rehearse] [--cell FILE]",
        "Serve the robots to a language model by the Model Context Protocol, over stdio with the key"
        " in $ROBOTREE_MCP_KEY, or at a PORT of loopback with keys as bearer tokens. --rehearse: over a"
        " simulated twin of the realm (of a realm FILE with --cell), where nothing real moves.",
        start="assisting:mcp",
        alters=True,
        needs=("mcp",),
        examples=("mcp --robots 'arm-*'", "mcp --http 7333", "mcp --rehearse"),
        guide=("robotree.assistants",),
    ),
    Action(
        "assistants [NAME]",
        "List the assistants that have keys, and their roles; of one, what it asked for lately and what"
        " became of it.",
        group=LOOK,
        where=Where.SHELL,
        start="assisting:assistants",
        examples=("assistants", "assistants claude --json"),
    ),
    shell(
        "assistant invite NAME",
        "Make the key of an assistant and print it, once; what it may do says the policy.",
        start="assisting:invite",
        alters=True,
        examples=("assistant invite claude",),
    ),
    shell(
        "assistant revoke NAME",
        "Take the key of an assistant back.",
        start="assisting:revoke",
        alters=True,
        examples=("assistant revoke claude",),
    ),
)
