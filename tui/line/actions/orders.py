"""Orders for robots that are away or busy."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, COMMAND, Action, Where

line = partial(Action, group=COMMAND)

VERBS = (
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
