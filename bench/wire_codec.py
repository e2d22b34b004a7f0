"""Our codec beside pymavlink's, interleaved in one run: medians of the time per message, and their ratios.

    python bench/wire_codec.py [--rounds N]

Both sides use fastcrc. Four telemetry messages: one of 40 bytes without an array, and our own joints, tool
and heartbeat. What is done is in `bench.wire.codec`; `python -m bench.wire codec` says whether the promises
hold.
"""

from __future__ import annotations

import sys
from pathlib import Path

from measuring import options

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.wire import codec


def main() -> None:
    """Print the table."""
    rounds, mavgen = options(__doc__, rounds=60).rounds, codec.generate()
    print(f"{'message':18}{'bytes':>6}  {'task':28}{'ours us':>9}{'pymavlink us':>14}{'ratio':>7}")
    for message in codec.messages():
        name, size = message.codec.definition.name, message.codec.definition.length
        for signed in (False, True):
            for contest in codec.contests(message, mavgen, signed=signed):
                ours, theirs, *_ = outcome = codec.compare(contest, rounds)
                print(f"{name:18}{size:6}  {contest.name:28}{ours:9.2f}{theirs:14.2f}{outcome.ratio:7.1f}")


if __name__ == "__main__":
    main()
