"""The asking side of a host."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.vr.address import Address
from robotree.vr.description import RobotDescription
from robotree.vr.exchange.asking import ask
from robotree.vr.requests import Create, Described, DescribeHost, HostDescribed
from robotree.vr.transport import Transport

if TYPE_CHECKING:  # only who creates something loads what reads sources
    from robotree.vr.bundle import Bundle

PATIENCE = 5.0
"""[s] for an answer that takes no work."""

LOADING = 20.0
"""[s] for a robot to be made: twice the loader's limit, for source and constructor, and the way."""


class HostClient:
    """Asks one host."""

    def __init__(self, transport: Transport, address: Address) -> None:
        """Point at a host."""
        self.address = address
        self._transport = transport

    async def describe(self, *, timeout: float = PATIENCE) -> HostDescribed:
        """Ask what it runs; `timeout` [s] to wait.

        Raises:
            TransportError: it cannot be reached or does not answer.
        """
        return await ask(self._transport, self.address.key, DescribeHost(), HostDescribed, timeout=timeout)

    async def create(self, bundle: Bundle, name: str) -> RobotDescription:
        """Have a virtual robot made of this source.

        Raises:
            AddressError: the name cannot be one, or is taken.
            BundleError: the source cannot be used.
            TransportError: the host cannot be reached or does not answer.
        """
        request = Create(name=name, path=bundle.path, source=bundle.source, wanted=bundle.wanted)
        answer = await ask(self._transport, self.address.key, request, Described, timeout=LOADING)
        return answer.robot
