"""Our codec beside pymavlink's, interleaved in one run: medians of the time per message, and their ratios.

    python bench/wire_codec.py [--rounds N] [--json]

Both sides use fastcrc. Four telemetry messages: one of 40 bytes without an array, and our own joints, tool
and heartbeat. What is done is in `bench.wire.codec`; `python -m bench.wire codec` says whether the promises
hold.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.wire import codec, reference


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    mavgen, rows = reference.generate(), []
    for message in codec.messages():
        name, size = message.codec.definition.name, message.codec.definition.length
        every = [one for signed in (False, True) for one in codec.contests(message, mavgen, signed=signed)]
        for contest in every:
            outcome = codec.compare(contest, arguments.rounds)
            row = {"message": name, "bytes": size, "task": contest.name, "ours_us": round(outcome.ours, 3)}
            rows.append(row | {"pymavlink_us": round(outcome.theirs, 3), "ratio": round(outcome.ratio, 2)})
    if arguments.json:
        print(json.dumps(rows))
        return
    print(f"{'message':18}{'bytes':>6}  {'task':28}{'ours us':>9}{'pymavlink us':>14}{'ratio':>7}")
    for row in rows:
        print("{message:18}{bytes:6}  {task:28}{ours_us:9.2f}{pymavlink_us:14.2f}{ratio:7.1f}".format(**row))


if __name__ == "__main__":
    main()
