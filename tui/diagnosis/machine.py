"""Checks of this machine: Python, packages, clock, terminal, keys, the folder for what is kept."""

from __future__ import annotations

import os
import platform
import shutil
import sys
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import NamedTuple

from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

from robotree.tui.diagnosis.finding import Finding
from robotree.tui.line.actions import ACTIONS
from robotree.tui.processes.terminal_graphics import pictures_here
from robotree.tui.terminal import no_screen
from robotree.vr.base.extras import MODULES, installation, lacks

OLDEST = (3, 11)
"""The first Python that works."""
SMALLEST = (40, 12)
"""Columns and lines below which the full screen shows too little."""
SIGNING_BEGINS = 1_420_070_400
"""[s since 1970] 2015-01-01: signatures count their time from there (mavlink.io, Message Signing)."""
SCARCE = 50_000_000
"""[bytes] of room below which journals and recordings soon fail."""


def python() -> Finding:
    """Say which Python runs this."""
    found = (
        f"Python {platform.python_version()} ({platform.python_implementation()}) on {platform.platform()}"
    )
    if sys.version_info < OLDEST:
        return Finding("python", "bad", found, f"use Python {'.'.join(map(str, OLDEST))} or newer")
    return Finding("python", "good", found)


class Needed(NamedTuple):
    """A package that robotree needs, or an extra of it."""

    name: str
    wanted: SpecifierSet
    have: str
    """Its version; empty: it is not installed."""

    @property
    def fits(self) -> bool:
        """Whether a version is installed that works (PEP 440)."""
        return bool(self.have) and self.wanted.contains(self.have, prereleases=True)


def packages(extra: str = "") -> list[Needed]:
    """Return what the core needs, or what an extra brings."""
    found: list[Needed] = []
    for wanted in map(Requirement, requires("robotree") or []):
        marker = wanted.marker
        if wanted.name != "robotree" and _applies(marker, extra) and not (extra and _applies(marker, "")):
            found.append(Needed(wanted.name, wanted.specifier, _version(wanted.name)))
    return found


def _applies(marker: Marker | None, extra: str) -> bool:
    return marker is None or marker.evaluate({"extra": extra})


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def installed() -> Iterator[Finding]:
    """See that the core's packages are there, in versions that work, and which extras are."""
    known = packages()
    for one in known:
        if not one.fits:
            yield Finding("packages", "bad", _misfit(one), installation())
    yield Finding("packages", "good", f"robotree {version('robotree')}; its core needs {len(known)} packages")
    for extra in MODULES:
        yield from _extra(extra)


def _extra(extra: str) -> Iterator[Finding]:
    """See whether an extra is installed: it need not be, but then it must be whole."""
    known = packages(extra)
    missing = [one.name for one in known if not one.have]
    if missing:
        result = f"robotree[{extra}] is not installed ({', '.join(missing)})"
        verbs = [f"`{action.verb}`" for action in ACTIONS if extra in action.needs]
        without = f"; {', '.join(verbs)} cannot be used without it" if verbs else ""
        yield Finding("extras", "doubt", result + without, installation(extra))
        return
    faults = [Finding("extras", "bad", _misfit(one), installation(extra)) for one in known if not one.fits]
    faults += [
        Finding("extras", "bad", f"robotree[{extra}] needs {lack.thing}, which is not there", lack.remedy)
        for lack in lacks(extra)
    ]
    yield from faults or [Finding("extras", "good", f"robotree[{extra}] is installed")]


def _misfit(one: Needed) -> str:
    wanted = f"{one.wanted} is needed" if one.wanted else "it is needed"
    return f"{one.name} {one.have} is installed, {wanted}" if one.have else f"{one.name} is not installed"


def clock(now: float | None = None) -> Finding:
    """See that the clock is not far behind: signatures carry its time, and certificates, too."""
    now = time.time() if now is None else now
    result = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(now))
    remedy = "set the clock, for example with `timedatectl set-ntp true`: signed links refuse what is too old"
    if now < SIGNING_BEGINS:
        return Finding("clock", "bad", f"the clock shows {result}, too early for signatures", remedy)
    newest = max((path.stat().st_mtime for path in Path(__file__).parent.glob("*.py")), default=0.0)
    if now < newest - 86_400:
        return Finding(
            "clock", "bad", f"the clock shows {result}, which is before robotree was installed", remedy
        )
    return Finding("clock", "good", f"the clock shows {result}")


def terminal() -> Iterator[Finding]:
    """See what the full screen has to work with."""
    if without := no_screen():
        yield Finding(
            "terminal", "doubt", f"the full screen needs a terminal, and {without}", "verbs work anyway"
        )
    able = abilities()
    result = ", ".join(f"{name} {value}" for name, value in able.items())
    columns, lines = shutil.get_terminal_size()
    if (columns, lines) < SMALLEST or lines < SMALLEST[1]:
        yield Finding(
            "terminal", "doubt", result, f"make it at least {SMALLEST[0]} columns by {SMALLEST[1]} lines"
        )
    elif "utf" not in able["encoding"].lower():
        yield Finding("terminal", "bad", result, "set LANG to a UTF-8 locale, for example LANG=C.UTF-8")
    else:
        yield Finding("terminal", "good", result)


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
        "pictures": pictures_here().graphics,
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
