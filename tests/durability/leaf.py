"""Robots in a process of their own, which write down each thing that they do.

    leaf.py FILE NAME…

A line of the file is `begin|end ROBOT NUMBER KEY TIME`.
"""

from __future__ import annotations

import asyncio
import os
import sys
import time
from pathlib import Path

from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.local import join

LOG = os.open(Path(sys.argv[1]), os.O_CREAT | os.O_WRONLY | os.O_APPEND, 0o600)


class Arm(Robot):
    """Counts what it does."""

    isolated = True
    done = 0

    def readings(self) -> dict[str, float]:
        return {"done": float(self.done)}

    def note(self, word: str, number: int) -> None:
        os.write(LOG, f"{word} {self.name} {number} {self.context.key} {time.monotonic():.4f}\n".encode())

    @command
    def act(self, n: int, seconds: float = 0.0) -> int:
        """Do one thing, which takes its time."""
        self.note("begin", n)
        if seconds:
            self.sleep(seconds)
        self.note("end", n)
        self.done += 1
        return n * 2


async def main() -> None:
    transport = await join()
    registrar = Registrar(transport)
    for name in sys.argv[2:]:
        await RobotAgent(Arm(name), transport, registrar=registrar).start()
    os.write(1, b"ready\n")
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    os._exit(0)


if __name__ == "__main__":
    asyncio.run(main())
