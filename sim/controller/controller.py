"""One robot's controller: the cell, its firmware, and the inbox between them and the links.

Frames may be posted from any thread; everything else happens in the thread that calls `advance`, one batch of
steps at a time. So a test in virtual time and a server in real time run the same code.
"""

from collections.abc import Hashable, Mapping

from robotree.protocol.frame import Frame
from robotree.sim.controller.inbox import Inbox, Opened, Received
from robotree.sim.firmware import Firmware, Outgoing
from robotree.sim.physics.cell import Cell


class Controller:
    """A cell with its firmware.

    Args:
        cell: the world.
        firmware: the program, moving that world's robot.
        cameras: names of the world's cameras by their MAVLink component.
    """

    def __init__(self, cell: Cell, firmware: Firmware, cameras: Mapping[int, str]) -> None:
        self.cell, self.firmware, self.cameras = cell, firmware, cameras
        self._inbox = Inbox(firmware.system)

    @property
    def stops(self) -> int:
        """How many stops have arrived so far, on all links."""
        return self._inbox.stops

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
            if isinstance(event, Received):
                out += self.firmware.receive(
                    event.frame, event.via, now, arrived=event.arrived, overtaken=event.overtaken
                )
            elif isinstance(event, Opened):
                out += self.firmware.greet(event.via, now)
            else:
                out += self.firmware.leave(event.via, now)
        self.firmware.gauges.overrun = self._inbox.dropped
        self.cell.advance()
        out += self.firmware.tick(self.cell.time_ms)
        return out
