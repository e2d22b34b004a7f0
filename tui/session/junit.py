"""A played session as a JUnit report, which test servers read. Pure.

One test suite for the session, one test case for each step. JUnit has no written standard; this is the form
that pytest writes: `testsuites`, `testsuite`, `testcase` with `failure`, `error` or `skipped`, times in [s].
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

from robotree.tui.errors import BadScript
from robotree.tui.session.script import Report

NOT_IN_XML = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, not even escaped (section 2.2)."""

SKIPPED = "a step before it did not hold"


class Case(NamedTuple):
    """One step of a session, or one trial of a suite."""

    name: str
    seconds: float = 0.0
    outcome: str = ""
    """`failure`, `error` or `skipped`; empty: it held."""
    text: str = ""
    script: str = ""
    """The file, if it is another one than the suite's."""


def of_report(report: Report) -> bytes:
    """Return the report of a session that was played, whole or in part."""
    cases = [
        Case(
            f"line {played.step.number}: {played.step.text}",
            played.took,
            "" if played.held else "failure",
            played.seen,
        )
        for played in report.told
    ]
    cases += [Case(text, 0.0, "skipped", SKIPPED) for text in report.left]
    return written(report.script, report.wall_s, cases)


def of_error(script: str, error: Exception) -> bytes:
    """Return the report of a session that was not played, or was broken off by an error."""
    if isinstance(error, BadScript):
        cases = [Case(f"line {number}", 0.0, "error", text) for number, text in error.mistakes]
    else:
        cases = [Case("session", 0.0, "error", str(error))]
    return written(script, 0.0, cases)


def written(script: str, seconds: float, cases: Sequence[Case]) -> bytes:
    """Return the report of these cases; `script` is the name of the suite, `seconds` how long it took."""
    counts = {
        f"{name}s" if name != "skipped" else name: str(sum(case.outcome == name for case in cases))
        for name in ("failure", "error", "skipped")
    }
    whole = ET.Element("testsuites")
    about = {"name": _plain(script), "tests": str(len(cases)), "time": f"{seconds:.3f}"}
    suite = ET.SubElement(whole, "testsuite", about | counts)
    for case in cases:
        element = ET.SubElement(
            suite,
            "testcase",
            classname=_plain(case.script or script),
            name=_plain(case.name),
            time=f"{case.seconds:.3f}",
        )
        if case.outcome:
            lines = _plain(case.text).splitlines() or [""]
            ET.SubElement(element, case.outcome, message=lines[0]).text = "\n".join(lines)
        elif case.text:
            ET.SubElement(element, "system-out").text = _plain(case.text)
    report: bytes = ET.tostring(whole, encoding="utf-8", xml_declaration=True)
    return report + b"\n"


def _plain(text: str) -> str:
    return NOT_IN_XML.sub("\N{REPLACEMENT CHARACTER}", text)
