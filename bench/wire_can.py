"""Round trips between two processes: PING over CAN and TCP, and the bus alone, beside a bare TCP echo.

    python bench/wire_can.py [ROUNDS]

All ways take turns in one run, so that the ratios hold on a noisy machine. The links' round trips are those
of `bench.wire.round_trips`; here the bus without link and event loop is added. Printed are medians; the
ratios are to the bare echo of the same round.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from pathlib import Path

import can

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.wire.round_trips import Way, compare

BUS_PAYLOAD = 60
"""[bytes] for the bus alone."""
TARGET = 3.0
"""The ratio that the link over CAN FD must keep."""


def echo_over_bus(channel: str) -> None:
    """The far process for the bus alone."""
    with can.Bus(interface="robotree", channel=channel) as bus:
        print("here", flush=True)
        for message in bus:
            if message.arbitration_id == 0:
                return
            bus.send(message)


def measure(channel: str, rounds: int) -> list[Way]:
    """Let all ways take turns."""
    words = [sys.executable, __file__, "bus", channel]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as far:
        if far.stdout is not None:
            far.stdout.readline()
        with can.Bus(interface="robotree", channel=channel) as bus:
            message = can.Message(arbitration_id=1, data=bytes(BUS_PAYLOAD), is_fd=True, bitrate_switch=True)

            async def over_bus() -> None:
                bus.send(message)
                if bus.recv(5) is None:
                    raise TimeoutError("the bus did not answer")

            told = asyncio.run(compare(rounds, more={f"bus alone, {BUS_PAYLOAD} bytes CAN FD": over_bus}))
            bus.send(can.Message(arbitration_id=0))
    return told


def report(ways: list[Way]) -> None:
    """Print a table, and whether the target was met."""
    print(f"{'round trip':32} {'median':>9} {'p99':>9} {'ratio':>6}   of 8 rounds in 10")
    for way in ways:
        tenth = len(way.ratios) // 10
        print(
            f"{way.name:32} {way.median * 1e6:6.0f} us {way.late * 1e6:6.0f} us {way.ratio:6.2f}"
            f"   {way.ratios[tenth]:.2f} to {way.ratios[-1 - tenth]:.2f}"
        )
    (fd,) = (way for way in ways if way.name == "PING over CAN FD")
    print(
        f"link over CAN FD: {fd.ratio:.2f} of {TARGET:g} allowed: {'met' if fd.ratio <= TARGET else 'MISSED'}"
    )


def main() -> None:
    """Measure and tell."""
    if sys.argv[1:2] == ["bus"]:
        echo_over_bus(sys.argv[2])
        return
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    report(measure(f"bench-{os.getpid()}-alone", rounds))


if __name__ == "__main__":
    main()
