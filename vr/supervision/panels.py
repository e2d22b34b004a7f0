"""The panel that a robot brings, as this machine judges it."""

from __future__ import annotations

from pathlib import PurePath
from typing import NamedTuple

from robotree.vr.base.address import everyone
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import VrError
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import BundleRead, DescribeHost, HostDescribed, ReadBundle
from robotree.vr.base.transport import Transport
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Gate
from robotree.vr.bundle.manifest import PANEL
from robotree.vr.bundle.panel import Panel, expect, read_panel
from robotree.vr.bundle.requested import bundle_of
from robotree.vr.exchange.asking import ask

ANSWERS_WITHIN = 3.0
"""[s]"""
FROM_AFAR = Principal(site="another site")


class JudgedPanel(NamedTuple):
    """What is shown of a robot that brings a panel."""

    panel: Panel | None = None
    """None: the generated form is shown."""
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
        hosted = await ask(transport, host, DescribeHost(), HostDescribed, timeout=ANSWERS_WITHIN)
        digest = hosted.pages.get(robot.name, "")
        if not digest:
            return JudgedPanel()
        answer = await ask(transport, host, ReadBundle(hash=digest), BundleRead, timeout=ANSWERS_WITHIN)
        if answer.page is None:
            return JudgedPanel()
        page = bundle_of(answer.page)
        if page.hash != digest:
            return JudgedPanel(reason="the panel is not shown: its host sent another page than it runs")
        return judged(page, robot, gate, here=_is_here(transport, host))
    except VrError as error:
        return JudgedPanel(reason=str(error))


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
    name = f"{PurePath(page.path).stem}{PANEL}"
    data = page.files.get(name)
    if data is None:
        return JudgedPanel()
    clearance = gate.admit(page, ITSELF if here else FROM_AFAR, "this machine")
    panel = read_panel(data, name)
    expect(panel, robot, clearance.permissions, name)
    return JudgedPanel(panel)


def _is_here(transport: Transport, key: str) -> bool:
    """Whether an agent is on this machine: what is on others, the gateway of this one holds."""
    held = transport.presence.held
    gateways = {one.where for one in held(everyone("gateway"))}
    return not any(one.where in gateways for one in held(key))
