"""Scripts and roles."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, SCRIPTS, About, Action, Where

shell = partial(Action, group=SCRIPTS, where=Where.SHELL)

VERBS = (
    Action(
        "role NAME ROLE",
        "Let a robot play a role from its next act on; ROLE: a name, or FILE.yaml with yours.",
        group=SCRIPTS,
        where=ANYWHERE,
        about=About.ROBOT,
        members="NAME",
        run="line.verbs:role",
        right="command",
        key="p",
        examples=("role companion child", "role companion waiter.yaml"),
        alters=True,
    ),
    shell(
        "rules check FILE [--listing]",
        "Check a script (FILE.yaml or FILE.clp); --listing: print the rules that it became.",
        start="rules:check",
        needs=("scripts",),
        examples=("rules check examples/guide.yaml", "rules check guide.yaml --listing"),
    ),
    shell(
        "rules test TABLE",
        "Play a table of events against a script, without any robot, and compare the orders.",
        start="rules:test",
        needs=("scripts",),
        examples=("rules test examples/guide.test.yaml",),
        guide=("robotree.vr.scripts.trial",),
    ),
    shell(
        "rules dry-run FILE [TABLE]",
        "Show what a script would do at the events of a TABLE, or of standard input, one per line.",
        start="rules:dry_run",
        needs=("scripts",),
        examples=("rules dry-run examples/guide.yaml", "rules dry-run guide.yaml guide.test.yaml"),
        guide=("robotree.vr.scripts.trial",),
    ),
    Action(
        "rules explain WHAT [RULE] [--after TABLE]",
        "Explain why a RULE fired or not, in a FILE or running script; without RULE: facts and agenda.",
        group=SCRIPTS,
        run="line.verbs:explain",
        start="rules:explain",
        examples=("rules explain guide greet", "rules explain guide.yaml greet --after guide.test.yaml"),
    ),
)
