"""The finding of a check, and how it is written. Pure."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

Grade = Literal["good", "doubt", "bad"]
"""`doubt`: it may be meant so; `bad`: something does not work."""

SIGNS: dict[Grade, str] = {"good": "✓", "doubt": "!", "bad": "✗"}
WIDTH, INDENT = 108, 14
"""Columns of the text, and where results begin."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of one check."""

    check: str
    """The subject of the check, in one word."""
    grade: Grade
    result: str
    """The observation, in one sentence."""
    remedy: str = ""
    """The remedy; empty where nothing need be done."""


def sound(findings: Iterable[Finding]) -> bool:
    """Whether nothing is bad."""
    return all(finding.grade != "bad" for finding in findings)


def structure(findings: Sequence[Finding]) -> dict[str, Any]:
    """Return all findings as plain data."""
    return {"ok": sound(findings), "checks": [asdict(finding) for finding in findings]}


def text(findings: Sequence[Finding]) -> str:
    """Return all findings for people: one line each, its remedy below it; last what it comes to."""
    lines: list[str] = []
    before = ""
    for finding in findings:
        head = finding.check if finding.check != before else ""
        lines += _wrapped(f"{SIGNS[finding.grade]} {head:<{INDENT - 3}} ", finding.result)
        if finding.remedy:
            lines += _wrapped(f"{'':{INDENT}}→ ", finding.remedy)
        before = finding.check
    counts = {grade: sum(finding.grade == grade for finding in findings) for grade in SIGNS}
    verdict = f"{counts['good']} good, {counts['doubt']} in doubt, {counts['bad']} bad"
    return "\n".join([*lines, "", verdict])


def _wrapped(lead: str, words: str) -> list[str]:
    indent = " " * len(lead)
    return textwrap.wrap(words, WIDTH, initial_indent=lead, subsequent_indent=indent, break_on_hyphens=False)
