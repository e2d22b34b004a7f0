"""Robots whose host is away: a person is told so, and a stop of everything is left for them."""

from __future__ import annotations

import time
from collections.abc import Collection
from contextlib import suppress
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


def leave_stop(realm: str, confirmed: Collection[str], directories: Collection[str]) -> list[str]:
    """Have robots that did not confirm a stop of everything begin stopped when their hosts are back. Blocks.

    Directories that did not confirm it hold all robots when they are back.

    Args:
        realm: that was stopped.
        confirmed: names of the robots that have confirmed it.
        directories: names of those that have confirmed it.

    Returns:
        A sentence for each host and directory that is concerned.

    Raises:
        NotConfirmed: the stop cannot be left; names the hosts and directories.
    """
    from robotree.tui.processes.state_files import directory_folders, journal_folders
    from robotree.vr.base.errors import NotConfirmed
    from robotree.vr.journal.kept import APART, leave_stop
    from robotree.vr.network.lean_stop import REASON
    from robotree.vr.orders.run import leave_stop as leave_to_directory

    sentences: list[str] = []
    untold: list[list[str]] = []
    for folder in journal_folders(realm):
        host = folder.parent.parent.name if folder.parent.name == APART else folder.name
        try:
            missed = leave_stop(folder, confirmed, REASON)
        except OSError as error:
            untold.append([f"host {host}", f"it is away, and {folder} cannot be written: {error.strerror}"])
        else:
            if missed:
                sentences.append(f"{', '.join(missed)} will be stopped when host {host} is back")
    for folder in directory_folders(realm):
        if folder.name in directories:
            continue
        try:
            leave_to_directory(folder, "a stop while it was away")
        except OSError as error:
            reason = f"it is away, and {folder} cannot be written: {error.strerror}"
            untold.append([f"directory {folder.name}", reason])
        else:
            sentences.append(
                f"directory {folder.name} is away: when it is back, it lets no robot begin what was ordered"
                " before `robotree resume`"
            )
    if untold:
        advice = ["make room there, or do not start these hosts", "stop again"]
        raise NotConfirmed(order="the protective stop", told=sorted(confirmed), untold=untold, advice=advice)
    return sentences


def leave_stop_apart(realm: str, missed: Collection[str]) -> list[str]:
    """Have robots apart that did not confirm their own stop begin stopped in their next process. Blocks.

    Args:
        realm: in which.
        missed: names of robots; of those that live in processes of their own here the stop is left.

    Returns:
        A sentence for each.
    """
    from robotree.tui.processes.state_files import journal_folders
    from robotree.vr.journal.kept import APART, leave_stop
    from robotree.vr.network.lean_stop import REASON

    sentences: list[str] = []
    for folder in journal_folders(realm):
        if folder.parent.name == APART and folder.name in missed:
            with suppress(OSError):  # then it is as it was said: not confirmed
                leave_stop(folder, (), REASON)
                sentences.append(f"{folder.name} will be stopped when its process is started again")
    return sentences


def take_stop_back(realm: str, robot: str = "") -> None:
    """Forget the stops that were left: everything is resumed, or one robot. Blocks.

    Args:
        realm: in which.
        robot: name of the one that is; of its own stop only, if it lives in a process of its own.

    Raises:
        OSError: one cannot be forgotten.
    """
    from robotree.tui.processes.state_files import directory_folders, journal_folders
    from robotree.vr.journal.kept import APART, take_stop_back
    from robotree.vr.orders.run import STOP

    for folder in journal_folders(realm):
        if not robot or (folder.parent.name, folder.name) == (APART, robot):
            take_stop_back(folder)
    if robot:
        return
    for folder in directory_folders(realm):
        (folder / STOP).unlink(missing_ok=True)
