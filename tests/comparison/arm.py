"""An arm as a program of its own, for the comparison: goals as lines of JSON over TCP, and a log.

It knows what an ordinary controller knows: a goal takes a second, a newer goal or `stop` ends it, and what
is under way when a connection ends goes on. Standard library only: it runs in every environment.

    python arm.py LOGFILE       prints its port; a line of JSON in LOGFILE for each goal that begins or ends
"""

from __future__ import annotations

import contextlib
import json
import socketserver
import sys
import threading
import time
from pathlib import Path
from typing import Any

MOTION = 1.0
"""[s] that a goal takes."""


class Arm:
    """The arm: one goal at a time."""

    def __init__(self, log: Path) -> None:
        """Begin at rest."""
        self._log = log
        self._lock = threading.Lock()
        self._number = 0

    def note(self, what: str, goal: Any) -> None:
        """Write a line."""
        with self._log.open("a") as file:
            file.write(json.dumps({"at": time.time(), "what": what, "goal": goal}) + "\n")

    def carry_out(self, goal: Any) -> bool:
        """Move; returns whether it got there."""
        with self._lock:
            self._number += 1
            mine = self._number
            self.note("begins", goal)
        end = time.monotonic() + MOTION
        while time.monotonic() < end and mine == self._number:
            time.sleep(0.01)
        reached = mine == self._number
        self.note("reached" if reached else "ended early", goal)
        return reached

    def stop(self) -> None:
        """End what is under way."""
        with self._lock:
            self._number += 1


def serve(log: Path) -> None:
    """Serve until killed."""
    arm = Arm(log)

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            for line in self.rfile:
                goal = json.loads(line)
                if goal == "stop":
                    arm.stop()
                    continue
                reached = arm.carry_out(goal)
                with contextlib.suppress(OSError):
                    self.wfile.write(json.dumps(reached).encode() + b"\n")

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        print(server.server_address[1], flush=True)  # noqa: T201 # a program
        server.serve_forever()


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
