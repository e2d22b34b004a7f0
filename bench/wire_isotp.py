"""Our ISO-TP state machine against can-isotp's own (TransportLayerLogic), without any bus, interleaved.

Each carries a payload one way between two stacks of its kind, flow control included. Prints medians.

    python bench/wire_isotp.py [ROUNDS]
"""

from __future__ import annotations

import statistics
import sys
import time
from collections import deque
from collections.abc import Callable

import isotp

from robotree.protocol.isotp import CLASSIC, FD, Channel

NEAR, FAR = 0x18DA8001, 0x18DA0180
SIZES = (52, 292)
"""[bytes] A MAVLink frame of 40 bytes of payload, and one of 280."""


def ours(width: int) -> Callable[[bytes], bytes | None]:
    """Two channels of ours."""
    near, far = Channel(width), Channel(width)

    def carry(payload: bytes) -> bytes | None:
        arrived = None
        under_way = deque(near.send(payload, 0.0))
        while under_way:
            heard = far.feed(under_way.popleft(), 0.0)
            arrived = heard.payload or arrived
            for reply in heard.reply:
                under_way += near.feed(reply, 0.0).reply
        return arrived

    return carry


def theirs(width: int) -> Callable[[bytes], bytes | None]:
    """Two stacks of theirs, driven by hand as their documentation shows."""
    lines: dict[int, deque[isotp.CanMessage]] = {NEAR: deque(), FAR: deque()}

    def stack(here: int, there: int) -> isotp.TransportLayerLogic:
        return isotp.TransportLayerLogic(
            rxfn=lambda _: lines[here].popleft() if lines[here] else None,
            txfn=lines[there].append,
            address=isotp.Address(isotp.AddressingMode.Normal_29bits, txid=there, rxid=here),
            params={"tx_data_length": width, "can_fd": width > CLASSIC, "blocking_send": False},
        )

    near, far = stack(NEAR, FAR), stack(FAR, NEAR)

    def carry(payload: bytes) -> bytes | None:
        near.send(payload)
        near.process()
        while lines[NEAR] or lines[FAR]:
            far.process()
            near.process()
        received = far.recv()
        return None if received is None else bytes(received)

    return carry


def main(rounds: int) -> None:
    """Measure."""
    for width in (FD, CLASSIC):
        for size in SIZES:
            payload = bytes(index % 256 for index in range(size))
            ways = {"ours": ours(width), "can-isotp": theirs(width)}
            seconds: dict[str, list[float]] = {name: [] for name in ways}
            for _ in range(rounds):
                for name, carry in ways.items():
                    began = time.perf_counter()
                    arrived = carry(payload)
                    seconds[name].append(time.perf_counter() - began)
                    if arrived != payload:
                        raise SystemExit(f"{name}: {size} bytes did not arrive")
            medians = {name: statistics.median(times) * 1e6 for name, times in seconds.items()}
            bus = "CAN FD" if width == FD else "classic CAN"
            print(
                f"{bus:12} {size:4} bytes   ours {medians['ours']:7.1f} us   "
                f"can-isotp {medians['can-isotp']:7.1f} us   {medians['can-isotp'] / medians['ours']:5.1f} x"
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500)
