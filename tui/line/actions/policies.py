"""Who may do what."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import LOOK, PROCESS, RIGHT_NAMES, Action, Where

shell = partial(Action, group=PROCESS, where=Where.SHELL)

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
)
