"""One robot's controller: the cell, its firmware, and the inbox between them and the links.

A controller has one MAVLink component or several, each with a program and a device of its own in the same
cell: an arm has one, a companion four. Every program receives every frame and takes what is for it.

Frames may be posted from any thread; everything else happens in the thread that calls `advance`, one batch of
steps at a time. So a test in virtual time and a server in real time run the same code.
"""

from collections.abc import Hashable, Iterable, Mapping

import msgspec

from robotree.protocol.frame import Frame
from robotree.protocol.services.camera import Camera
from robotree.sim.controller.inbox import Inbox, InboxEvent, Opened, Received
from robotree.sim.firmware import COMPONENT, Firmware, Outgoing
from robotree.sim.physics.cell import Cell


class Controller:
    """A cell with its programs.

    Args:
        cell: the world.
        firmware: the program of the first component, which answers for the whole controller.
        cameras: names of the world's cameras by their MAVLink component.
        others: the programs of its other components.
    """

    def __init__(
        self, cell: Cell, firmware: Firmware, cameras: Mapping[int, str], others: Iterable[Firmware] = ()
    ) -> None:
        self.cell, self.firmware, self.cameras = cell, firmware, cameras
        self.programs = (firmware, *others)
        self.components = tuple(each.component for each in self.programs)
        self._camera_components = [Camera(firmware.system, each, name) for each, name in cameras.items()]
        self._inbox = Inbox(firmware.system, self.components)

    @property
    def stops(self) -> int:
        """How many stops have arrived so far, on all links."""
        return self._inbox.stops

    @property
    def waiting(self) -> bool:
        """Whether anything that was posted has not been heard yet."""
        return self._inbox.waiting

    def post(self, frame: Frame, via: Hashable, stops: int | None = None) -> None:
        """Leave a frame that came over the link `via`, to be heard before the next batch. From any thread.

        A link that brings more than its share loses some; see `inbox`.

        Args:
            frame: intact.
            via: the link.
            stops: how many stops had arrived when its bytes came, if they waited since.
        """
        self._inbox.put(frame, via, stops, self.cell.time_ms)

    def greet(self, via: Hashable) -> None:
        """A link `via` was opened; who is on it is told at once what this is. From any thread."""
        self._inbox.open(via)

    def leave(self, via: Hashable) -> None:
        """The link `via` has ended. From any thread."""
        self._inbox.close(via)

    def advance(self) -> list[Outgoing]:
        """Hear what was posted, let the world go on for one batch, and say what is to be said."""
        out: list[Outgoing] = []
        now = self.cell.time_ms
        for event in self._inbox.take():
            for program in self.programs:
                out += _spoken_by(program, _take(program, event, now))
            if isinstance(event, Received):
                for camera in self._camera_components:
                    sent = camera.receive(event.frame, event.via, now / 1000)
                    out += [Outgoing(each.message, each.via, component=camera.component) for each in sent]
        self.firmware.gauges.overrun = self._inbox.dropped
        self.cell.advance()
        for program in self.programs:
            out += _spoken_by(program, program.tick(self.cell.time_ms))
        for camera in self._camera_components:
            beats = camera.tick(self.cell.time_ms / 1000)
            out += [Outgoing(each, telemetry=True, component=camera.component) for each in beats]
        return out


def _take(program: Firmware, event: InboxEvent, now: int) -> list[Outgoing]:
    if isinstance(event, Received):
        return program.receive(event.frame, event.via, now, arrived=event.arrived, overtaken=event.overtaken)
    return program.greet(event.via, now) if isinstance(event, Opened) else program.leave(event.via, now)


def _spoken_by(program: Firmware, out: list[Outgoing]) -> list[Outgoing]:
    """Return the messages of a program, with its component as the sender."""
    if program.component == COMPONENT:
        return out
    return [msgspec.structs.replace(each, component=program.component) for each in out]
