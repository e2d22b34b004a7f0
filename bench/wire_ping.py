"""PING between two processes over TCP beside a bare asyncio echo of the same bytes; the cost of ten clients.

    python bench/wire_ping.py [--rounds N] [--json]

What is done is in `robotree.protocol.tools.measure.round_trips`; `robotree wire bench trips clients` says
whether the promises hold.
"""

from __future__ import annotations

import argparse
import asyncio
import json

from robotree.protocol.tools.measure.far import CLIENTS, RATE, TELEMETRY
from robotree.protocol.tools.measure.round_trips import BYTES, compare, crowd


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=1000)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    bare, tcp, *_ = asyncio.run(compare(arguments.rounds))
    cost = asyncio.run(crowd())
    if arguments.json:
        figures = {"echo_us": bare.median * 1e6, "ping_us": tcp.median * 1e6, "ratio": tcp.ratio}
        print(json.dumps(figures | {"arrived": cost.complete, "share_of_core": cost.share}))
        return
    print(f"bare asyncio echo of {BYTES} bytes  {bare.median * 1e6:7.1f} us")
    print(f"PING over the TCP link          {tcp.median * 1e6:7.1f} us   {tcp.ratio:.2f}x")
    print(
        f"{CLIENTS} clients, {len(TELEMETRY)} messages at {RATE:g} Hz   {100 * cost.share:7.1f} % of a core"
    )


if __name__ == "__main__":
    main()
