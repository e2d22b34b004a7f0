"""What is wrong with a page, as its author should know it."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec
    from robotree.vr.bundle import Bundle
    from robotree.vr.bundle.reading import Finding

Kinds = Mapping[str, Mapping[str, "CommandSpec"]]
"""The commands of the kinds that come with robotree, by name of the kind."""

PYTHON = f"{sys.version_info[0]}.{sys.version_info[1]}"
_LINE = re.compile(r"line (\d+): ")
_PLACE = re.compile(r"line (\d+), column \d+: ")


def findings(bundle: Any, kinds: Kinds) -> list[Finding]:
    """Return what is wrong with a page: read it, then load it as a host would."""
    from robotree.vr.base.errors import BundleError
    from robotree.vr.bundle.check import examine
    from robotree.vr.bundle.reading import Finding

    try:
        found = examine(bundle.source, kinds)
    except SyntaxError as error:
        return [Finding(error.lineno or 1, str(error.msg), f"write it as Python {PYTHON} reads it")]
    except ValueError as error:
        return [Finding(1, str(error), "save the file as text")]
    try:
        bundle.examine()
    except BundleError as error:
        text = str(error.data.get("reason", error))
        where = _LINE.search(text)
        number = int(where[1]) if where else 1
        what = _LINE.sub("", text, count=1)
        if not any(one.line == number and one.what in what for one in found):
            found.append(Finding(number, what, "a host refuses the page like this"))
    return sorted(found, key=lambda one: one.line)


def panel_findings(bundle: Bundle) -> dict[str, list[Finding]]:
    """Return what is wrong with the panels beside a page that can be loaded, by file."""
    from robotree.vr.base.address import Address
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.errors import BadPanel
    from robotree.vr.bundle.manifest import PANEL, PROGRAM
    from robotree.vr.bundle.panel import expect, read_panel
    from robotree.vr.bundle.reading import Finding

    page = PurePath(bundle.path)
    layout, program = f"{page.stem}{PANEL}", f"{page.stem}{PROGRAM}"
    found: dict[str, list[Finding]] = {}
    if (data := bundle.files.get(layout)) is not None:
        cls, commands = bundle.examine()
        robot = RobotDescription(address=Address("robot", page.stem, "none"), kinds=(cls,), commands=commands)
        try:
            expect(read_panel(data, layout), robot, None, layout)
        except BadPanel as error:
            reason = str(error.data["reason"])
            where = _PLACE.match(reason)
            number, reason = (int(where[1]), reason[where.end() :]) if where else (1, reason)
            found[str(page.with_name(layout))] = [Finding(number, reason, "until then a form is shown")]
    if (data := bundle.files.get(program)) is not None:
        try:
            compile(data, program, "exec", dont_inherit=True)
        except (SyntaxError, ValueError) as error:
            line = error.lineno or 1 if isinstance(error, SyntaxError) else 1
            advice = f"write it as Python {PYTHON} reads it"
            found[str(page.with_name(program))] = [Finding(line, str(getattr(error, "msg", error)), advice)]
    return found
