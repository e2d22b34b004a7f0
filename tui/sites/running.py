"""The processes that join machines: `robotree hub` and `robotree gateway`."""

from __future__ import annotations

import asyncio
import datetime as dt
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.processes.state_files import needed_file
from robotree.tui.sites.realms import keys_of
from robotree.tui.terminal import answer
from robotree.vr.base.errors import VrError
from robotree.vr.network.local import join
from robotree.vr.sites.frames import SiteStopped
from robotree.vr.sites.gateway import Gateway
from robotree.vr.sites.hub import (
    HubAddress,
    HubCertificate,
    address_of,
    as_file,
    certificate_in,
    open_hub,
    settings,
)
from robotree.vr.sites.stopping import came_of
from robotree.vr.sites.zenoh_pipe import ZenohPipe
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.supervision.stop import StopScope

if TYPE_CHECKING:
    from robotree.vr.agents.run import Ready

HUBS = "hubs"
"""Folder with the certificate of this machine's hubs, beside those of the realms."""


def print_config(line: Line) -> int:
    """Print the configuration with which the official zenohd is a hub."""
    address, certificate = _listening(line)
    found = settings(address, certificate)
    answer(as_file(found), lambda: found)
    return exit_codes.DONE


async def run_hub(line: Line, _realm: str, ready: Ready) -> None:
    """Be a hub until cancelled."""
    address, certificate = _listening(line)
    session = await asyncio.get_running_loop().run_in_executor(None, open_hub, address, certificate)
    try:
        ready(address.text if certificate is None else f"{address.text}#{certificate.fingerprint}")
        await asyncio.Event().wait()
    finally:
        session.close()


async def run_gateway(_line: Line, realm: str, ready: Ready) -> None:
    """Be the gateway of a realm on this machine until cancelled."""
    keys = keys_of(realm)
    transport = await join(realm)
    try:
        realm_client = RealmClient(transport, realm)

        async def stop_here(order: str, reason: str) -> SiteStopped:
            del reason  # each stop has the same
            scope = StopScope(local=gateway.is_local)
            try:
                return came_of(await realm_client.stop(None, order=order, scope=scope))
            except VrError as error:
                return came_of(error)

        gateway = Gateway(
            transport,
            ZenohPipe(keys.hubs),
            keys,
            ground=transport.mesh,
            stop_here=stop_here,
            version=installed_version(),
        )
        try:
            await gateway.open()
            ready(gateway.address.key)
            await asyncio.Event().wait()
        finally:
            await gateway.close()
            await realm_client.close()
    finally:
        await transport.close()


def installed_version() -> str:
    """Return the version of robotree; empty: it is not installed."""
    with suppress(PackageNotFoundError):
        return version("robotree")
    return ""


def _listening(line: Line) -> tuple[HubAddress, HubCertificate | None]:
    try:
        address = address_of(line.text("--listen"))
    except ValueError as error:
        raise ValueRefused("ADDRESS", str(error)) from None
    if address.scheme == "tcp":
        return address, None
    return address, certificate_in(needed_file(HUBS, "tls"), dt.datetime.now(dt.UTC))
