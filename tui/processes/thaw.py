"""A small process that freezes another one for a drill, and wakes it whatever happens to who has asked.

It stops the process with SIGSTOP and continues it with SIGCONT: when the time is over, or when its standard
input ends, which it does when the program that has started it ends in any way, killed or not. The process is
named by a pidfd, so nobody else can be meant who has its number later.

It is this file, run alone: an interpreter without `site`, in a session of its own.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys

STDIN = 0
READY = b"frozen\n"


def freeze(pidfd: int, seconds: float) -> subprocess.Popen[bytes]:
    """Freeze a process for a time [s]; to end it earlier, close the standard input of what is returned.

    Raises:
        OSError: the helper cannot be started, or the process is none of ours, or not there.
    """
    helper = subprocess.Popen(
        [sys.executable, "-I", "-S", __file__, str(pidfd), repr(seconds)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        pass_fds=(pidfd,),
        start_new_session=True,  # Ctrl-C and a closed terminal are not for it
    )
    assert helper.stdout is not None  # noqa: S101 # a pipe
    if helper.stdout.readline() != READY:
        helper.wait()
        raise ProcessLookupError("it is not there any more, or not ours")
    return helper


def _main() -> int:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # a service manager sends them to both
    target, seconds = int(sys.argv[1]), float(sys.argv[2])
    try:
        signal.pidfd_send_signal(target, signal.SIGSTOP)
    except OSError:
        return 1
    try:
        with contextlib.suppress(OSError):  # who has asked may be gone
            os.write(1, READY)
        events = select.poll()
        events.register(STDIN, 0)  # the hang-up is always reported
        events.poll(seconds * 1000.0)
    finally:
        with contextlib.suppress(OSError):  # it has been killed meanwhile
            signal.pidfd_send_signal(target, signal.SIGCONT)
    return 0


if __name__ == "__main__":
    sys.exit(_main())
