"""The pages that a realm file names, as they lie on the disk: there, and those that it means."""

from __future__ import annotations

from collections.abc import Mapping

from robotree.tui.line import values
from robotree.tui.realm_file.content import RealmFile, RobotEntry, placed
from robotree.tui.realm_file.plan import Page
from robotree.vr.base.errors import BrokenScript, BundleError
from robotree.vr.bundle import Bundle

DIGITS = 12
"""Of a hash that an error shows."""
ROLE_FILES = (".yaml", ".yml")


def pages_of(wanted: RealmFile) -> Mapping[str, Page]:
    """Read the pages of the robots of a file, by name of the robot. Blocks.

    Raises:
        BadRealmFile: one is not there, or is not the one that the file means.
    """
    return {robot.name: _page(robot, wanted) for robot in wanted.robots}


def _page(robot: RobotEntry, wanted: RealmFile) -> Page:
    given, name = values.source(robot.page.text)
    path = placed(given, wanted.folder)
    try:
        bundle = Bundle.read(path, name)
    except BundleError as error:
        raise wanted.error(robot.page.mark, f"the page of {robot.name}: {error}") from None
    if robot.hash is not None and not bundle.hash.startswith(robot.hash.text):
        reason = (
            f"{path}, the page of {robot.name}, has changed: its hash is {bundle.hash[:DIGITS]}…, not "
            f"{robot.hash.text[:DIGITS]}…; bring the page that is meant back, or write the new hash"
        )
        raise wanted.error(robot.hash.mark, reason)
    role, role_file = _role(robot, wanted)
    return Page(f"{path}:{name}" if name else path, bundle.hash, role, role_file)


def _role(robot: RobotEntry, wanted: RealmFile) -> tuple[str, str]:
    """Return name and path of the role that is in a file; empty: the entry names no file."""
    if robot.role is None or not robot.role.text.endswith(ROLE_FILES):
        return "", ""
    from robotree.vr.scripts.roles.profile import read_profile

    path = placed(robot.role.text, wanted.folder)
    try:
        return read_profile(Bundle.read(path).source, path).name, path
    except (BundleError, BrokenScript) as error:
        raise wanted.error(robot.role.mark, f"the role of {robot.name}: {error}") from None
