"""Measure what the wire promises, and say whether it holds here; the exit code is 1 if a promise does not.

    python -m bench.wire [codec] [trips] [noise]

Without a part all are measured.
"""

from __future__ import annotations

import argparse
import sys

from bench.wire.figures import FIGURES, Figure


def as_text(figure: Figure) -> str:
    """One figure for people."""
    promise = figure.promise
    sign = "≥" if promise.at_least else "≤"
    value = f"{figure.value:.4g}" if figure.value < 1e4 else f"{figure.value:.0f}"
    mark = "kept" if figure.kept else "NOT KEPT"
    head = f"{promise.name:38} {value:>8} {promise.unit:12} {sign} {promise.bound:<8g} {mark:8}"
    return f"{head}  {figure.detail}".rstrip()


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(FIGURES))
    arguments = parser.parse_args()
    if unknown := {*arguments.parts} - {*FIGURES}:
        parser.error(f"{', '.join(sorted(unknown))} is not measured; there is {', '.join(FIGURES)}")
    kept = True
    for part in arguments.parts or FIGURES:
        print(f"measuring {part} …", file=sys.stderr)
        for figure in FIGURES[part]():
            kept = kept and figure.kept
            print(as_text(figure))
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
