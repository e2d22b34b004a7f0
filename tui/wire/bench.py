"""`robotree wire bench`: measure what the wire promises, and say whether it holds here."""

from __future__ import annotations

import json

from robotree.protocol.tools.measure.figures import FIGURES, Figure
from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import note, put


def bench(line: Line, _realm: str) -> int:
    """Measure everything, or the parts that were named; 1 if a promise was not kept."""
    parts = line.many("PART") or tuple(FIGURES)
    for part in parts:
        if part not in FIGURES:
            raise ValueRefused("PART", f"{part!r} is not measured; there is {', '.join(FIGURES)}")
    kept = True
    for part in parts:
        note(f"measuring {part} …")
        for figure in FIGURES[part]():
            kept = kept and figure.kept
            put(to_json(figure) if line.flag("--json") else to_text(figure))
    return exit_codes.DONE if kept else exit_codes.REFUSED


def to_json(figure: Figure) -> str:
    """One figure as an object."""
    data = {"name": figure.promise.name, "value": figure.value, "unit": figure.promise.unit}
    bound = {"at_least" if figure.promise.at_least else "at_most": figure.promise.bound}
    return json.dumps({**data, **bound, "kept": figure.kept, "detail": figure.detail})


def to_text(figure: Figure) -> str:
    """One figure for people."""
    promise = figure.promise
    sign = "≥" if promise.at_least else "≤"
    value = f"{figure.value:.4g}" if figure.value < 1e4 else f"{figure.value:.0f}"
    mark = "kept" if figure.kept else "NOT KEPT"
    head = f"{promise.name:38} {value:>8} {promise.unit:12} {sign} {promise.bound:<8g} {mark:8}"
    return f"{head}  {figure.detail}".rstrip()
