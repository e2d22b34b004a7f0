"""`python -m robotree.tui` is the command line `robotree`. A stop is sent before anything else is loaded."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False
"""As `typing.TYPE_CHECKING`, which takes a tenth as long to import as Python to start."""
if TYPE_CHECKING:
    from typing import NoReturn


def program() -> NoReturn:
    """Run the command line of this process and end the process."""
    order = ""
    try:
        if "stop" in sys.argv:
            import signal

            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            order = _stop_first()  # whole, also if a person presses Ctrl-C meanwhile
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        from robotree.tui import cli
    except KeyboardInterrupt:
        what = "interrupted; the stop has been sent, and is not confirmed" if order else "interrupted"
        os.write(2, f"robotree: {what}\n".encode())
        os._exit(130)
    cli.program(order)


def _stop_first() -> str:
    """Send the stop that this line asks for; return the id of its order, empty if there is none."""
    from contextlib import suppress

    from robotree.vr.network.lean_stop import send_first

    with suppress(Exception):  # a fault in it must not hinder the full order
        return send_first(sys.argv[1:])
    return ""


if __name__ == "__main__":
    program()
