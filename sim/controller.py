"""One robot's box: the world, the program, and the mailbox between them and the links.

Frames may be posted from any thread; everything else happens in whichever thread calls `advance`, one batch
of steps at a time. So a test in virtual time and a server in real time run the very same code.
"""

from collections import deque
from collections.abc import Hashable, Mapping

from robotree.protocol.frame import Frame
from robotree.sim.cell import Cell
from robotree.sim.firmware import Firmware, Outgoing


class Controller:
    """A cell with its firmware.

    Args:
        cell: the world.
        firmware: the program, moving that world's robot.
        cameras: names of the world's cameras by their MAVLink component.
    """

    def __init__(self, cell: Cell, firmware: Firmware, cameras: Mapping[int, str]) -> None:
        self.cell, self.firmware, self.cameras = cell, firmware, cameras
        self._inbox: deque[tuple[Frame | None, Hashable]] = deque()

    def post(self, frame: Frame, via: Hashable) -> None:
        """Leave a frame that came over the link `via`; it is heard before the next batch. From any thread."""
        self._inbox.append((frame, via))

    def greet(self, via: Hashable) -> None:
        """A link `via` was opened; who is on it is told at once what this is. From any thread."""
        self._inbox.append((None, via))

    def advance(self) -> list[Outgoing]:
        """Hear what was posted, let the world go on for one batch, and say what is to be said."""
        out: list[Outgoing] = []
        while self._inbox:
            frame, via = self._inbox.popleft()
            now = self.cell.time_ms
            out += self.firmware.greet(via, now) if frame is None else self.firmware.hear(frame, via, now)
        self.cell.advance()
        out += self.firmware.tick(self.cell.time_ms)
        return out
