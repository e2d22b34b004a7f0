"""A host for one robot alone: a process that is started here and outlives this one.

So a page that holds the interpreter, or crashes it, takes no other robot with it. The host ends when its
robot is deleted, or when none has come within a minute.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator

from robotree.tui.processes.detached import start_detached


@contextlib.asynccontextmanager
async def own_host(realm: str, robot: str) -> AsyncGenerator[str]:
    """Start a host for a robot that is made in this block; if it is not, the host ends.

    Args:
        realm: in which it lives.
        robot: name of the robot.

    Yields:
        The host's name.

    Raises:
        MemberFailed: it did not come up.
    """
    name = f"{robot}-host"
    started = await asyncio.to_thread(start_detached, realm, name, ("host", name, "--only", robot))
    try:
        yield name
    except BaseException:
        started.process.terminate()
        raise
