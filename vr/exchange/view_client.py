"""The asking side of a view."""

from __future__ import annotations

from robotree.vr.address import Address
from robotree.vr.exchange.asking import ask
from robotree.vr.requests import DescribeView, Look, Picture, ViewDescribed
from robotree.vr.transport import Transport

PATIENCE = 5.0
"""[s] to wait for a picture: two attempts at a busy renderer, and the way."""


class ViewClient:
    """Looks at one view, wherever it is."""

    def __init__(self, transport: Transport, address: Address) -> None:
        """Point at a view."""
        self.address = address
        self._transport = transport

    async def describe(self) -> ViewDescribed:
        """Ask for its cameras and its readings.

        Raises:
            TransportError: it cannot be reached or does not answer.
        """
        return await ask(self._transport, self.address.key, DescribeView(), ViewDescribed, timeout=PATIENCE)

    async def look(
        self, camera: str = "", *, width: int = 320, height: int = 180, quality: int = 75
    ) -> Picture:
        """Take one picture. Whoever wants a film asks again when the last one has come.

        Args:
            camera: empty: the view's first.
            width: [px]
            height: [px]
            quality: of the JPEG, 1 to 100.

        Raises:
            VrError: there is no such camera, or no picture can be had.
            TransportError: the view cannot be reached or does not answer.
        """
        request = Look(camera=camera, width=width, height=height, quality=quality)
        return await ask(self._transport, self.address.key, request, Picture, timeout=PATIENCE)
