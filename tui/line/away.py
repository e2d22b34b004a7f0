"""A robot that does not run may be one that a host keeps that is away: then a person is told so."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robotree.vr.base.errors import NoSuchRobot, VrError


def explained(realm: str, error: NoSuchRobot) -> VrError:
    """Return the error with the host that keeps the robot, if there is one on this machine. Blocks.

    Args:
        realm: in which the robot was looked for.
        error: names it.
    """
    from robotree.tui.processes.state_files import history_files
    from robotree.tui.seen.status import span
    from robotree.vr.base.errors import RobotAway
    from robotree.vr.journal.kept import kept_away

    name = str(error.data["name"])
    for (role, host), path in history_files(realm).items():
        kept = kept_away(path.parent) if role == "host" else None
        if kept is not None and name in kept.running:
            running = " and ".join(kept.running[name])
            return RobotAway(
                name=name,
                host=host,
                since=span(max(0.0, time.time() - kept.since)),
                goes_on=f", and {running} goes on then" if running else "",
            )
    return error
