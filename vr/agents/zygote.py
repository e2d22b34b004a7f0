"""Makes processes for robots apart: it has loaded what they need, and forks itself.

The host asks through a socket, with the descriptor of the robot's pipe; it is told the number of the new
process, and later how that has ended. No author's code runs here, and there is one thread.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import signal
import socket
import sys

from robotree.files import forks
from robotree.vr.agents import inside
from robotree.vr.isolation.confine import end_with_parent
from robotree.vr.isolation.nursery import ENDED, STARTED


def main(descriptor: int, parent: int) -> None:
    """Serve the host, until it has gone."""
    end_with_parent(parent)
    host = socket.socket(fileno=descriptor)
    host.setblocking(True)
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    os.set_blocking(woken, False)
    signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
    signal.set_wakeup_fd(wake)
    for number in forks.ASKS:
        signal.signal(number, signal.SIG_IGN)  # a Ctrl-C goes to the whole group: the host decides
    gc.collect()
    gc.freeze()
    while True:
        ready, _, _ = select.select([host.fileno(), woken], [], [])
        if woken in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(woken, 4096)
        _tell_ended(host)
        if host.fileno() in ready and not _start(host, (woken, wake)):
            os._exit(0)


def _start(host: socket.socket, own: tuple[int, int]) -> bool:
    """Make the process that the host asks for; returns whether the host is there."""
    try:
        data, descriptors, _, _ = socket.recv_fds(host, 16, 1)
    except OSError:
        return False
    if not data or not descriptors:
        return False
    zygote = os.getpid()
    child = os.fork()
    if child == 0:
        _become(host, own)
        with contextlib.suppress(BaseException):
            inside.main(descriptors[0], zygote)
        os._exit(1)
    os.close(descriptors[0])
    host.send(STARTED.pack(child))
    return True


def _become(host: socket.socket, own: tuple[int, int]) -> None:
    """In the child: be a process of its own."""
    forks.be_process()
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.setsid()
    host.close()
    for each in own:
        os.close(each)


def _tell_ended(host: socket.socket) -> None:
    with contextlib.suppress(ChildProcessError, OSError):
        while True:
            child, status = os.waitpid(-1, os.WNOHANG)
            if child == 0:
                return
            host.send(ENDED.pack(child, os.waitstatus_to_exitcode(status)))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
