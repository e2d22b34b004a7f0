"""Views among agents: a picture is made when somebody asks for one, and for nobody else.

The looker pulls: one `Look`, one picture. So the looker sets size and rate, a slow looker gets fewer pictures
and never a queue of old ones, and nothing is rendered while nobody looks.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

from robotree.vr.base.description import Listing
from robotree.vr.base.requests import AnyRequest, DescribeView, Look, Picture, Reply, Shot, ViewDescribed
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.claim import Declarations, claim, new_address
from robotree.vr.exchange.dispatcher import Dispatcher, not_for
from robotree.vr.lookup.registrar import Registrar

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Second bytes of the markers that begin a frame of a JPEG picture (ITU-T T.81, annex B)."""


def jpeg_size(picture: bytes) -> tuple[int, int]:
    """Return width and height [px] from the header of a JPEG picture; zeros when the bytes are none."""
    at = 2 if picture[:2] == b"\xff\xd8" else len(picture)
    while at + 9 <= len(picture) and picture[at] == 0xFF:
        marker = picture[at + 1]
        if marker in _FRAMES:
            height, width = (int.from_bytes(picture[at + i : at + i + 2], "big") for i in (5, 7))
            return width, height
        at += 2 + int.from_bytes(picture[at + 2 : at + 4], "big")
    return 0, 0


class View(Protocol):
    """A source of pictures of a workspace."""

    @property
    def cameras(self) -> Sequence[str]:
        """The cameras of the view; the first one is the default."""
        ...

    @property
    def reading_units(self) -> Mapping[str, str]:
        """Symbol of the unit of each reading, by its name; what is not here is a plain number."""
        ...

    def readings(self) -> Mapping[str, float]:
        """Return what the instruments of the workspace read, in SI units."""
        ...

    async def look(self, camera: str, width: int, height: int, quality: int) -> bytes:
        """Take one picture, as JPEG.

        Args:
            camera: one of `cameras`; empty: the first.
            width: [px] wished for.
            height: [px] wished for.
            quality: of the JPEG, 1 to 100.

        Raises:
            VrError: there is no such camera, or no picture can be had.
        """
        ...


@runtime_checkable
class PlacedView(View, Protocol):
    """A view that knows where its cameras are."""

    @property
    def frame(self) -> str:
        """Name of the frame in which its cameras are, as in `ViewDescribed`."""
        ...

    @property
    def skeleton(self) -> Sequence[tuple[float, float, float]]:
        """Where the joints of its arm are in that frame [m], from foot to tool; empty: nobody says."""
        ...

    async def shoot(self, camera: str, width: int, height: int, quality: int) -> Shot:
        """Take one picture, as `look`, with where its camera was."""
        ...


class ViewAgent:
    """Serves the pictures of one view."""

    def __init__(self, view: View, transport: Transport, name: str, *, registrar: Registrar) -> None:
        """Prepare the agent.

        Args:
            view: what it shows.
            transport: the way to the others.
            name: of the view.
            registrar: where it is listed.

        Raises:
            BadName: the name cannot be one.
        """
        self.address = new_address("view", name)
        self._view, self._transport, self._registrar = view, transport, registrar
        self._declared = Declarations()

    async def start(self) -> None:
        """Serve, be present, be listed.

        Raises:
            DuplicateName: a living view has this name.
            TransportError: the transport does not work.
        """
        async with Declarations() as declared:
            dispatcher = Dispatcher(
                self.address.name,
                lambda received, _: self._answer(received.request),
                now=asyncio.get_running_loop().time,
                here=Here("view", self.address.name, self._transport.gate, lambda: ("View",)),
            )
            await declared.keep(self._transport.serve(self.address.key, dispatcher.take))
            await declared.keep(claim(self._transport, self.address))
            declared.push_async_callback(self._registrar.leave, self.address)
            cameras = {"cameras": ", ".join(self._view.cameras)}
            listing = Listing(address=self.address, kinds=("View",), attributes=cameras)
            await self._registrar.enter(listing)
            self._declared = declared.pop_all()

    async def close(self) -> None:
        """Leave. Twice is once."""
        await self._declared.aclose()

    async def _answer(self, request: AnyRequest) -> Reply:
        match request:
            case Look(camera=camera, width=width, height=height, quality=quality):
                view = self._view
                if isinstance(view, PlacedView):
                    jpeg, lens = await view.shoot(camera, width, height, quality)
                else:
                    jpeg, lens = await view.look(camera, width, height, quality), None
                width, height = await asyncio.to_thread(jpeg_size, jpeg)
                camera = camera or next(iter(self._view.cameras), "")
                return Picture(jpeg=jpeg, width=width, height=height, camera=camera, lens=lens)
            case DescribeView():
                return ViewDescribed(
                    address=self.address,
                    cameras=tuple(self._view.cameras),
                    readings=dict(self._view.readings()),
                    units=dict(self._view.reading_units),
                    frame=self._view.frame if isinstance(self._view, PlacedView) else "",
                    skeleton=tuple(self._view.skeleton) if isinstance(self._view, PlacedView) else (),
                )
            case _:
                raise not_for("view", request)
