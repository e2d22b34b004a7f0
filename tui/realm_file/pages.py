"""The pages that a realm file names, as they lie on the disk: there, as it means them, with what it names."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping

from robotree.tui.line import values
from robotree.tui.realm_file.content import RealmFile, RobotEntry, placed
from robotree.tui.realm_file.plan import Page
from robotree.vr.base.errors import BrokenScript, BundleError
from robotree.vr.base.written import suggestion
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.reading import ROOT, last
from robotree.vr.bundle.reading import pages_of as declared
from robotree.vr.bundle.syntax import parse

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
    _expect_names(robot, bundle, wanted)
    role, role_file = _role(robot, wanted)
    return Page(f"{path}:{name}" if name else path, bundle.hash, role, role_file)


def _expect_names(robot: RobotEntry, bundle: Bundle, wanted: RealmFile) -> None:
    """Refuse a page that is no Python, and slots and settings that its text shows not to be there.

    Raises:
        BadRealmFile: it cannot be read, or has none of this name.
    """
    try:
        tree = parse(bundle.source)
    except (SyntaxError, ValueError) as error:
        if not bundle.path.endswith(".py"):
            return  # a script
        line = error.lineno if isinstance(error, SyntaxError) and error.lineno else 1
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        text = f"the page of {robot.name} is no Python: {bundle.path}:{line}: {reason}"
        raise wanted.error(robot.page.mark, text) from None
    classes = {one.name: one for one in tree.body if isinstance(one, ast.ClassDef)}
    page = next((one for name, one in declared(tree).items() if bundle.wanted in {"", name}), None)
    if page is None or not _shown_whole(classes[page.name], classes):
        return
    for slot, children in robot.slots.items():
        if slot.partition("[")[0] not in page.slots:
            mark = children[0].mark if children else robot.mark
            raise wanted.error(mark, _unknown(page.name, "slot", slot, page.slots))
    for slot, watched in robot.watches.items():
        if slot not in page.watches:
            raise wanted.error(watched.mark, _unknown(page.name, "slot that watches", slot, page.watches))
    for setting, value in robot.settings.items():
        if setting not in page.settings:
            raise wanted.error(value.mark, _unknown(page.name, "setting", setting, page.settings))


def _shown_whole(node: ast.ClassDef, classes: Mapping[str, ast.ClassDef]) -> bool:
    """Whether all that a class inherits stands in its file."""
    names = [last(base) for base in node.bases]
    return all(name == ROOT or (name in classes and _shown_whole(classes[name], classes)) for name in names)


def _unknown(page: str, what: str, name: str, known: Iterable[str]) -> str:
    names = sorted(known)
    return f"{page} has no {what} {name!r}{suggestion(name, names)}; it has: {', '.join(names) or 'none'}"


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
