"""The panel that a robot brings, as this machine judges it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import NamedTuple

from robotree.vr.base.address import everyone
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import BadPanel, VrError
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import BundleRead, DescribeHost, HostDescribed, ReadBundle
from robotree.vr.base.transport import Transport
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Gate
from robotree.vr.bundle.bundle import bundle_of
from robotree.vr.bundle.manifest import PANEL, PROGRAM
from robotree.vr.bundle.panel import Panel, expect, read_panel
from robotree.vr.exchange.asking import ask

ANSWERS_WITHIN = 3.0
"""[s]"""
LARGEST_PROGRAM = 200_000
"""[bytes] of a panel that is a program."""
FROM_AFAR = Principal(site="another site")


class ProgramSource(NamedTuple):
    """A panel that is a program, for a process of its own."""

    source: str
    path: str
    files: Mapping[str, bytes]
    """That belong to the page, by path."""
    permissions: Permissions | None
    """Of the page; None: it is not limited."""


class JudgedPanel(NamedTuple):
    """What is shown of a robot that brings a panel."""

    panel: Panel | None = None
    program: ProgramSource | None = None
    """Of both None: the generated form is shown."""
    reason: str = ""
    """Why its own is not shown, as a sentence; empty: it brings none, or it is shown."""


async def panel_of(transport: Transport, robot: RobotDescription, host: str, gate: Gate) -> JudgedPanel:
    """Ask for the panel that a robot brings, and judge it.

    Args:
        transport: the way to its host.
        robot: as it describes itself.
        host: key of its host.
        gate: decides whom this machine trusts.
    """
    try:
        page, meant = await _fetched(transport, robot, host)
        if page is None:
            return JudgedPanel()
        if page.hash != meant:
            return JudgedPanel(reason="the panel is not shown: its host sent another page than it runs")
        return judged(page, robot, gate, here=_is_here(transport, host))
    except VrError as error:
        return JudgedPanel(reason=str(error))


async def source_of(transport: Transport, robot: RobotDescription, host: str) -> str:
    """Ask for the page that a robot runs, to be read; empty: its host does not have it.

    Args:
        transport: the way to its host.
        robot: as it describes itself.
        host: key of its host.

    Raises:
        VrError: the host does not answer.
    """
    page, meant = await _fetched(transport, robot, host)
    return page.source if page is not None and page.hash == meant else ""


async def _fetched(transport: Transport, robot: RobotDescription, host: str) -> tuple[Bundle | None, str]:
    """Ask for the page that a robot runs; None: its host has none. With the hash that it must have."""
    hosted = await ask(transport, host, DescribeHost(), HostDescribed, timeout=ANSWERS_WITHIN)
    if not (digest := hosted.pages.get(robot.name, "")):
        return None, ""
    answer = await ask(transport, host, ReadBundle(hash=digest), BundleRead, timeout=ANSWERS_WITHIN)
    return None if answer.page is None else bundle_of(answer.page), digest


def judged(page: Bundle, robot: RobotDescription, gate: Gate, *, here: bool) -> JudgedPanel:
    """Judge the panel of a page.

    Args:
        page: with what belongs to it.
        robot: as it describes itself.
        gate: decides whom this machine trusts.
        here: whether it came from this machine.

    Raises:
        BundleError: the panel is not shown; says why.
    """
    stem = PurePath(page.path).stem
    program, name = f"{stem}{PROGRAM}", f"{stem}{PANEL}"
    if not {program, name} & page.files.keys():
        return JudgedPanel()
    clearance = gate.admit(page, ITSELF if here else FROM_AFAR, "this machine")
    panel = None
    if (data := page.files.get(name)) is not None:
        panel = read_panel(data, name)
        expect(panel, robot, clearance.permissions, name)
    if (data := page.files.get(program)) is None:
        return JudgedPanel(panel)
    from robotree.vr.isolation.apart import lack_for  # most panels need nothing of it

    if lack := lack_for("process"):
        return JudgedPanel(
            panel, reason=f"the panel {program} is not shown: {lack} to keep its process apart"
        )
    return JudgedPanel(
        panel, ProgramSource(_text(data, program), program, _helpers(page), clearance.permissions)
    )


def _helpers(page: Bundle) -> Mapping[str, bytes]:
    """Return what lies beside a page, without its panels; nothing if no module is among it."""
    others = {file: data for file, data in page.files.items() if not file.endswith((PANEL, PROGRAM))}
    return others if any(file.endswith(".py") for file in others) else {}


def _text(data: bytes, name: str) -> str:
    """Read a program.

    Raises:
        BadPanel: it is too large, or no text.
    """
    if len(data) > LARGEST_PROGRAM:
        raise BadPanel(path=name, reason=f"it has {len(data)} bytes, and {LARGEST_PROGRAM} are allowed")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadPanel(path=name, reason="it is not UTF-8 text") from None


def _is_here(transport: Transport, key: str) -> bool:
    """Whether an agent is on this machine: what is on others, the gateway of this one holds."""
    held = transport.presence.held
    gateways = {one.where for one in held(everyone("gateway"))}
    return not any(one.where in gateways for one in held(key))
