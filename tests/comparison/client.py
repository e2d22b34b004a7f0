"""The driver of the arm, which all peers use and none is charged for. Standard library only."""

from __future__ import annotations

import json
import socket
import threading
from typing import Any


class Goal:
    """A goal under way."""

    def __init__(self) -> None:
        """Nothing is known."""
        self.ended = threading.Event()
        self.error = ""
        """Why it was not reached; empty: it was."""


class ArmClient:
    """Sends goals to the arm; each over a connection of its own."""

    def __init__(self, port: int) -> None:
        """Point at it."""
        self.port = port

    def start(self, **goal: Any) -> Goal:
        """Begin a goal and return at once."""
        under_way = Goal()
        threading.Thread(target=self._follow, args=(goal, under_way), daemon=True).start()
        return under_way

    def stop(self) -> None:
        """End what is under way."""
        with socket.create_connection(("127.0.0.1", self.port)) as connection:
            connection.sendall(b'"stop"\n')

    def _follow(self, goal: dict[str, Any], under_way: Goal) -> None:
        try:
            with socket.create_connection(("127.0.0.1", self.port)) as connection:
                connection.sendall(json.dumps(goal).encode() + b"\n")
                answer = connection.makefile().readline()
            if not answer:
                under_way.error = "the connection has ended"
            elif not json.loads(answer):
                under_way.error = "it was ended early"
        except OSError as error:
            under_way.error = str(error)
        under_way.ended.set()
