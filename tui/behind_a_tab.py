"""The program behind a tab of a browser: loads the full screen, waits to be wanted, and is `robotree` then.

python -m robotree.tui.behind_a_tab FD

It is started before anybody asks, for loading takes most of a second. One line of JSON comes from the
descriptor FD: the words of the command line. Where it ends before, nobody wanted this one. Its terminal is
standard input; when that closes, the screen ends as in any terminal, and so does what it has begun on robots.
"""

from __future__ import annotations

import fcntl
import json
import os
import sys
import termios
from importlib import import_module

IN_ADVANCE = (
    "client.joining",
    "tui.cli",
    "tui.line.taken",
    "tui.screen.supervise",
    "tui.screen.user_app",
    "vr.network.local",
    "vr.supervision.realm_client",
)
"""Modules that the screen needs."""


def main() -> int:
    """Wait to be wanted, and be the full screen."""
    waiting = int(sys.argv[1])
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    for name in IN_ADVANCE:
        import_module(f"robotree.{name}")
    with os.fdopen(waiting, "rb") as line:
        wanted = line.readline()
    if not wanted:
        return 0
    from robotree.tui import cli

    return cli.main(json.loads(wanted))


if __name__ == "__main__":
    sys.exit(main())
