"""The files of a composition: checked before they are written, and written only where nothing is.

What was written is the person's from then on: a file that is there is replaced only when that is asked for.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from robotree.files import overwrite
from robotree.tui.composing.lines import written
from robotree.tui.composing.page import described_in, texts
from robotree.tui.composing.steps import Checked, Composition, Kinds, checked
from robotree.tui.errors import BadComposition
from robotree.tui.line.findings import findings, panel_findings
from robotree.tui.line.known_kinds import known_kinds
from robotree.vr.base.description import RobotDescription
from robotree.vr.bundle import Bundle

STEPS: Final = ".steps"
"""Ends the name of the file with the composition itself, from which one can go on composing."""
TRIAL: Final = "robotree.testing.trial"
"""The module that carries a page out in a twin of the cell."""
LONGEST_TRIAL: Final = 600.0
"""[s] that it may compute."""


class KnownRobots(msgspec.Struct, frozen=True):
    """What is known of the robots that can be composed."""

    kinds: Kinds
    """Their commands, by name of the kind."""
    shipped: frozenset[str]
    """The kinds that come with robotree."""
    described: Mapping[str, RobotDescription]
    """How a living or recorded robot of each other kind describes itself."""

    @classmethod
    def of(cls, robots: Iterable[RobotDescription] = ()) -> KnownRobots:
        """Return the kinds that come with robotree, and those of these robots."""
        shipped = known_kinds()
        others = {robot.kind: robot for robot in robots if robot.kind not in shipped}
        kinds = {kind: {one.name: one for one in robot.commands} for kind, robot in others.items()}
        return cls({**kinds, **shipped}, frozenset(shipped), others)


class Tried(msgspec.Struct, frozen=True):
    """How a page went in a twin of the cell."""

    ok: bool
    error: str = ""
    """Why it failed; empty: it went well."""
    seconds: float = 0.0
    """[s] of the twin's time."""
    simulated: tuple[str, ...] = ()
    """The slots with simulated robots; those in the others only answered."""
    thing: tuple[float, ...] = ()
    """[m] where the thing lay in the end that was there to be taken; empty: none was."""

    @property
    def told(self) -> str:
        """As a sentence."""
        if not self.simulated:
            what = "with robots that only answer, for none of them can be simulated"
        else:
            what = "in a twin of the cell"
        if not self.ok:
            return f"tried {what}: it failed: {self.error}"
        place = ", ".join(f"{each:.3f}" for each in self.thing)
        lay = f"; the thing lay at {place} m then" if place else ""
        return f"tried {what}: it went well, {self.seconds:.1f} s{lay}"


class Prepared(msgspec.Struct, frozen=True):
    """The files of a composition, before they are written."""

    checked: Checked
    files: Mapping[str, str]
    """By name."""
    lines: int
    """Of the page."""

    @property
    def page(self) -> str:
        """The name of the page's file."""
        return f"{self.checked.composition.name}.py"


def prepared(composition: Composition, robots: KnownRobots, origin: str) -> Prepared:
    """Return the files of a composition; its page was checked as `robotree check` does.

    Args:
        composition: what is wanted.
        robots: that can be in its slots.
        origin: how it was composed, in one line.

    Raises:
        BadComposition: it cannot be meant, or a host would refuse its page.
        OSError: no file can be written at all.
    """
    good = checked(composition, robots.kinds)
    name = good.composition.name
    files = texts(good, robots.kinds, robots.shipped, origin) | {f"{name}{STEPS}": written(composition)}
    for slot, kind in good.composition.slots:
        if kind in robots.described:
            files[described_in(name, slot)] = _description(robots.described[kind])
    ready = Prepared(good, files, len(files[f"{name}.py"].splitlines()))
    with tempfile.TemporaryDirectory(prefix="robotree-compose-") as folder:
        _put(files, Path(folder))
        bundle = Bundle.read(str(Path(folder) / ready.page), "")
        found = [(ready.page, one) for one in findings(bundle, robots.kinds)]
        if not found:
            found += [(Path(file).name, one) for file, some in panel_findings(bundle).items() for one in some]
    for file, one in found:
        if one.level == "mistake":
            raise BadComposition(f"{file} would not be taken: line {one.line}: {one.what}: {one.instead}")
    return ready


def write(ready: Prepared, folder: Path, *, replace: bool) -> list[str]:
    """Write the files into a folder.

    Args:
        ready: what is written.
        folder: where.
        replace: whether files that are there are replaced.

    Returns:
        The names of the files.

    Raises:
        FileExistsError: one is there, and is not replaced; none was written.
        OSError: one cannot be written.
    """
    if not replace:
        refuse_present(ready, folder)
    _put(ready.files, folder)
    return list(ready.files)


def refuse_present(ready: Prepared, folder: Path) -> None:
    """Refuse to write what is there.

    Raises:
        FileExistsError: one of the files is in the folder.
    """
    if present := [name for name in ready.files if (folder / name).exists()]:
        raise FileExistsError(f"{', '.join(present)} is there already, and is yours; nothing was written")


def _put(files: Mapping[str, str], folder: Path) -> None:
    for name, text in files.items():
        overwrite(folder / name, text.encode())


def _description(robot: RobotDescription) -> str:
    """Return what a robot says of itself that lasts, as a fake reads it."""
    lasting = RobotDescription(
        address=robot.address, kinds=robot.kinds, doc=robot.doc, commands=robot.commands, units=robot.units
    )
    return json.dumps(msgspec.to_builtins(lasting), indent=1, ensure_ascii=False) + "\n"


# -- the trial -------------------------------------------------------------------------------------


def trial_of(ready: Prepared, arguments: Mapping[str, Any], things: Mapping[str, Sequence[float]]) -> bytes:
    """Return what the trial of a page is asked for, without its folder.

    Args:
        ready: the page.
        arguments: of its command; the others are its defaults.
        things: [m] x and y of a thing on the table, by the slot of the arm at that table.
    """
    made = ready.checked.composition
    files = {slot: described_in(made.name, slot) for slot, _ in made.slots}
    robots = {slot: files[slot] if files[slot] in ready.files else kind for slot, kind in made.slots}
    asked = {
        "page": ready.page, "command": made.command, "arguments": dict(arguments), "robots": robots,
        "things": {slot: list(place) for slot, place in things.items()},
    }  # fmt: skip
    return msgspec.json.encode(asked)


def things_of(composition: Composition) -> dict[str, tuple[float, float]]:
    """Return where a thing must lie so that what was shown can be done: where it was taken first."""
    given = dict(composition.parameters)
    if "from_x" not in given or "from_y" not in given:
        return {}
    arms = [slot for slot, kind in composition.slots if kind == "Arm"]
    return {slot: (float(given["from_x"]), float(given["from_y"])) for slot in arms[:1]}


def tried(
    ready: Prepared,
    arguments: Mapping[str, Any] | None = None,
    things: Mapping[str, Sequence[float]] | None = None,
) -> Tried:
    """Carry a page out in a twin of the cell, in a process of its own; nothing real moves.

    Args:
        ready: the page.
        arguments: of its command.
        things: see `trial_of`; None: as what was shown needs it.

    Raises:
        OSError: no process can be started, or no file written.
    """
    made = ready.checked.composition
    asked = trial_of(ready, arguments or {}, things_of(made) if things is None else things)
    with tempfile.TemporaryDirectory(prefix="robotree-trial-") as folder:
        _put(ready.files, Path(folder))
        try:
            done = subprocess.run(
                [sys.executable, "-m", TRIAL],
                input=asked,
                cwd=folder,
                capture_output=True,
                timeout=LONGEST_TRIAL,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return Tried(ok=False, error=f"it computed for {LONGEST_TRIAL:.0f} s without an end")
    rows = done.stdout.decode(errors="replace").strip().splitlines()
    try:
        return msgspec.json.decode(rows[-1], type=Tried)
    except (IndexError, msgspec.MsgspecError):
        said = done.stderr.decode(errors="replace").strip().splitlines()
        return Tried(ok=False, error=said[-1] if said else f"its process ended with code {done.returncode}")
