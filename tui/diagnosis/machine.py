"""Checks of this machine: Python, packages, clock, terminal, keys, the folder for what is kept."""

from __future__ import annotations

import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from robotree.tui.diagnosis.finding import Finding
from robotree.tui.terminal import no_screen

OLDEST = (3, 11)
"""The first Python that works."""
SMALLEST = (40, 12)
"""Columns and lines below which the full screen shows too little."""
SIGNING_BEGINS = 1_420_070_400
"""[s since 1970] 2015-01-01: signatures count their time from there (mavlink.io, Message Signing)."""
SCARCE = 50_000_000
"""[bytes] of room below which journals and recordings soon fail."""

_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*])?\s*([^;]*)(?:;\s*(.*))?")
_BOUND = re.compile(r"(>=|<=|==|!=|<|>)\s*([0-9.]+)")


def python() -> Finding:
    """Say which Python runs this."""
    found = (
        f"Python {platform.python_version()} ({platform.python_implementation()}) on {platform.platform()}"
    )
    if sys.version_info < OLDEST:
        return Finding("python", "bad", found, f"use Python {'.'.join(map(str, OLDEST))} or newer")
    return Finding("python", "good", found)


def packages() -> Mapping[str, tuple[str, str]]:
    """Return the installed version (empty: none) and the wanted one, by package that robotree needs."""
    found: dict[str, tuple[str, str]] = {}
    for line in requires("robotree") or []:
        part = _REQUIREMENT.match(line)
        if part is None or "extra" in (part[3] or ""):
            continue
        try:
            found[part[1]] = (version(part[1]), part[2].strip())
        except PackageNotFoundError:
            found[part[1]] = ("", part[2].strip())
    return found


def installed() -> Iterator[Finding]:
    """See that all packages are there, in versions that work."""
    known = packages()
    for name, (have, wanted) in known.items():
        if not have:
            yield Finding("packages", "bad", f"{name} is not installed", "`make setup` installs it")
        elif not fits(have, wanted):
            yield Finding(
                "packages",
                "bad",
                f"{name} {have} is installed, {wanted} is needed",
                "`make setup` installs it",
            )
    told = f"robotree {version('robotree')}; {len(known)} packages that it needs are installed"
    yield Finding("packages", "good", told)


def fits(have: str, wanted: str) -> bool:
    """Whether a version is within bounds such as `>=1.10.2,<1.11`; compares numbers, part by part."""
    mine = _numbers(have)
    for sign, bound in _BOUND.findall(wanted):
        other = _numbers(bound)
        width = max(len(mine), len(other))
        one, two = (numbers + (0,) * (width - len(numbers)) for numbers in (mine, other))
        holds = {">=": one >= two, "<=": one <= two, "==": one == two, "!=": one != two, "<": one < two}
        if not holds.get(sign, one > two):
            return False
    return True


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", text.partition("+")[0]))


def clock(now: float | None = None) -> Finding:
    """See that the clock is not far behind: signatures carry its time, and certificates, too."""
    now = time.time() if now is None else now
    told = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(now))
    remedy = "set the clock, for example with `timedatectl set-ntp true`: signed links refuse what is too old"
    if now < SIGNING_BEGINS:
        return Finding(
            "clock",
            "bad",
            f"the clock shows {told}, too early for signatures",
            remedy,
        )
    newest = max((path.stat().st_mtime for path in Path(__file__).parent.glob("*.py")), default=0.0)
    if now < newest - 86_400:
        return Finding(
            "clock", "bad", f"the clock shows {told}, which is before robotree was installed", remedy
        )
    return Finding("clock", "good", f"the clock shows {told}")


def terminal() -> Iterator[Finding]:
    """See what the full screen has to work with."""
    if without := no_screen():
        yield Finding(
            "terminal", "doubt", f"the full screen needs a terminal, and {without}", "verbs work anyway"
        )
    able = abilities()
    told = ", ".join(f"{name} {value}" for name, value in able.items())
    columns, lines = shutil.get_terminal_size()
    if (columns, lines) < SMALLEST or lines < SMALLEST[1]:
        yield Finding(
            "terminal", "doubt", told, f"make it at least {SMALLEST[0]} columns by {SMALLEST[1]} lines"
        )
    elif "utf" not in able["encoding"].lower():
        yield Finding("terminal", "bad", told, "set LANG to a UTF-8 locale, for example LANG=C.UTF-8")
    else:
        yield Finding("terminal", "good", told)


def abilities() -> dict[str, str]:
    """Return what the terminal is and can, by name, as far as the environment says so."""
    environment = os.environ
    term = environment.get("TERM", "")
    if "NO_COLOR" in environment:
        colours = "none (NO_COLOR)"
    elif environment.get("COLORTERM", "") in {"truecolor", "24bit"}:
        colours = "16 million"
    else:
        colours = "256" if "256" in term else "16" if term not in {"", "dumb"} else "none"
    columns, lines = shutil.get_terminal_size()
    within = [
        name
        for name, key in (("tmux", "TMUX"), ("screen", "STY"), ("ssh", "SSH_CONNECTION"))
        if key in environment
    ]
    return {
        "type": term or "unknown",
        "size": f"{columns}x{lines}",
        "colours": colours,
        "encoding": getattr(sys.stdout, "encoding", "") or "unknown",
        "within": " in ".join(within) or "nothing else",
    }  # fmt: skip


def room(folder: Path) -> Finding:
    """See that what must survive a restart can be kept."""
    there = next((one for one in (folder, *folder.parents) if one.exists()), Path("/"))
    if not os.access(there, os.W_OK | os.X_OK):
        return Finding(
            "state", "bad", f"{there} cannot be written to", "set XDG_STATE_HOME to a folder of your own"
        )
    free = shutil.disk_usage(there).free
    if free < SCARCE:
        return Finding("state", "bad", f"{there} has {free // 1_000_000} MB left", "make room on that disk")
    return Finding("state", "good", f"{folder} can be written to, {free // 1_000_000_000} GB are free")
