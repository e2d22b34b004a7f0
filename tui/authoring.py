"""`robotree check` and `robotree new`: for authors of pages, without any robot.

robotree check team.py
robotree new team --over arm
"""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import structs

from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line import sources
from robotree.tui.line.findings import Kinds, findings, panel_findings
from robotree.tui.line.grammar import Line
from robotree.tui.line.known_kinds import known_kinds
from robotree.tui.terminal import answer
from robotree.vr.base.extras import lacks

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.bundle.reading import Finding


def check(line: Line, _realm: str) -> int:
    """Print what is probably wrong with a page.

    Returns:
        The exit code: 0 when nothing was found but warnings.
    """
    from robotree.vr.bundle import Bundle
    from robotree.vr.bundle.bundle import is_script

    path, wanted = sources.found(line.text("FILE"))
    if is_script(path):
        raise ValueRefused(
            "FILE",
            f"{path} is a script, not a page; check it with `robotree rules check {shlex.quote(path)}`",
        )
    bundle = Bundle.read(path, wanted)
    kinds = known_kinds()
    by_file = {str(path): findings(bundle, kinds)}
    if not any(one.level == "mistake" for one in by_file[str(path)]):  # else its commands are not known
        by_file |= panel_findings(bundle)
    found = [(file, one) for file, some in by_file.items() for one in some]
    rows = [f"{file}:{one.line}: {_mark(one)}{one.what}: {one.instead}" for file, one in found]
    data = [{"file": file, **structs.asdict(one)} for file, one in found]
    answer("\n".join(rows) or f"{path}: no mistake was found", lambda: data)
    return exit_codes.REFUSED if any(one.level == "mistake" for _, one in found) else exit_codes.DONE


def _mark(found: Finding) -> str:
    return "warning: " if found.level == "warning" else ""


PAGE = '''"""{Class}: what it is for, in one line."""

from typing import Annotated

{kinds}from robotree.vr import {imports}


class {Class}(VirtualRobot):
    """Its purpose, in one line."""

    speed: Annotated[float, Unit("m/s"), Range(0.01, 0.3), "how quickly it goes"] = 0.1
    done: int = state(0)
{slot}
    @command
    def work(self, times: Annotated[int, Range(1, 20)] = 3) -> int:
        """Do it some times."""
        for number in range(times):
            self.sleep(0.1)
            self.progress((number + 1) / times, f"{{number + 1}} of {{times}}")
        self.done += 1
        return self.done
{exposed}'''

TEST = '''"""How {Class} behaves."""

from {module} import {Class}

from robotree.testing import {imports}


def test_it_counts_what_it_has_done() -> None:
    {name} = rehearse({Class}{children})
    assert {name}.call("work", times=2) == 1
'''

PYRIGHT = {"include": ["."], "typeCheckingMode": "standard", "reportMissingModuleSource": False}

EDITOR = """{
  "python.analysis.typeCheckingMode": "standard",
  "python.testing.pytestEnabled": true,
  "python.testing.pytestArgs": ["."]
}
"""


def new(line: Line, _realm: str) -> int:
    """Write a page, its test and the settings of an editor into the present folder; nothing is overwritten.

    Raises:
        ValueRefused: the name cannot be that of a module, or there is no such kind.
        FileExistsError: one of the files is there already; none was written.
    """
    name = line.text("NAME")
    if not name:
        return _list_offered()
    module = name.replace("-", "_")
    if not module.isidentifier():
        raise ValueRefused("NAME", f"{name!r} cannot be the name of a page; begin with a letter")
    if module in sys.stdlib_module_names:
        raise ValueRefused("NAME", f"Python has a module {module!r} itself; take another, such as my-{name}")
    if line.text("--from"):
        return _begin_with(line.text("--from"), module, name)
    kinds = known_kinds()
    kind = _kind(line.text("--over"), kinds)
    written = _files(module, kind, exposes="get_info" in kinds.get(kind, {}))
    settings = {path for path in written if path not in {f"{module}.py", f"test_{module}.py"}}
    made = _write({path: text.encode() for path, text in written.items()}, settings)
    then = [
        f"robotree check {module}.py",
        *(lack.remedy for lack in lacks("testing")),
        f"pytest test_{module}.py",
        f"robotree create {module}.py as {name}",
    ]
    rows = [*(f"made {path}" for path in made), "", "next:", *(f"  {one}" for one in then)]
    answer("\n".join(rows), lambda: {"made": made, "next": then})
    return exit_codes.DONE


def _list_offered() -> int:
    """Print the pages that installed packages offer."""
    pages = sources.offered()
    rows = [
        f"{one.name:<16} {one.package:<24} {one.file or f'{one.says}, which is not there'}" for one in pages
    ]
    if pages:
        rows += [
            "",
            "robotree create PAGE as NAME makes a robot; robotree new NAME --from PAGE begins with it",
        ]
    data = [{**one._asdict(), "file": None if one.file is None else str(one.file)} for one in pages]
    answer("\n".join(rows) or "no installed package offers pages (`robotree.pages`)", lambda: data)
    return exit_codes.DONE


def _begin_with(given: str, module: str, name: str) -> int:
    """Copy a page, and what belongs to it, into the present folder under another name."""
    from robotree.vr.bundle import Bundle
    from robotree.vr.bundle.manifest import PANEL

    path, wanted = sources.found(given)
    page = Bundle.read(path, wanted)
    old = Path(page.path)
    own = {f"{old.stem}{PANEL}": f"{module}{PANEL}"}
    beside = {own.get(file, file): data for file, data in page.files.items()}
    own_file = f"{module}{old.suffix}"
    made = _write({own_file: page.source.encode(), **beside})
    chosen = f"{own_file}:{page.wanted}" if page.wanted else own_file
    then = [f"robotree check {chosen}"] * (old.suffix == ".py") + [f"robotree create {chosen} as {name}"]
    rows = [*(f"made {one}" for one in made), "", "next:", *(f"  {one}" for one in then)]
    answer("\n".join(rows), lambda: {"made": made, "next": then})
    return exit_codes.DONE


def _write(files: Mapping[str, bytes], settings: Collection[str] = ()) -> list[str]:
    """Write files into the present folder; returns which were written.

    Args:
        files: their content by path.
        settings: of an editor, which stay as they are.

    Raises:
        FileExistsError: one of the others is there already; none was written.
    """
    if present := [path for path in files if Path(path).exists() and path not in settings]:
        raise FileExistsError(f"{', '.join(present)} is there already; nothing was written")
    made = [path for path in files if not Path(path).exists()]
    for path in made:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        with Path(path).open("xb") as file:
            file.write(files[path])
    return made


def _checkers() -> dict[str, str]:
    """Return the settings of pyright and mypy, by file.

    They are told where robotree is if it is installed from its repository; a wheel needs nothing of that.
    """
    import robotree.vr

    place = Path(str(robotree.vr.__file__)).resolve().parents[1] / "typings"
    there = (place / "robotree").is_dir()
    pyright = PYRIGHT | ({"extraPaths": [str(place)]} if there else {})
    files = {"pyrightconfig.json": json.dumps(pyright, indent=2) + "\n"}
    return files | ({"mypy.ini": f"[mypy]\nmypy_path = {place}\n"} if there else {})


def _kind(given: str, kinds: Kinds) -> str:
    known = {kind.lower(): kind for kind in kinds}
    if given and given.lower() not in known:
        raise ValueRefused("KIND", f"{given!r} is no kind that is known: {', '.join(kinds)}")
    return known.get(given.lower(), "")


def _files(module: str, kind: str, *, exposes: bool) -> dict[str, str]:
    """Return the texts of the files, by path."""
    words = {
        "module": module,
        "name": module,
        "Class": "".join(part.capitalize() for part in module.split("_")),
        "imports": ", ".join([*(["Child"] if kind else []), "Range, Unit, VirtualRobot, command, state"]),
        "slot": f'\n    {kind.lower()} = Child({kind}, "the robot that does it")\n' if kind else "",
        "kinds": f"from robotree.kinds import {kind}\n" if kind else "",
        "exposed": f"\n    get_info = {kind.lower()}.exposed()\n" if exposes else "",
        "children": "",
    }
    page = PAGE.format(**words)
    words["imports"] = "Fake, rehearse" if kind else "rehearse"
    words["children"] = f", {kind.lower()}=Fake({kind})" if kind else ""
    test = TEST.format(**words)
    if kind:
        test = test.replace(
            "\nfrom robotree.testing",
            f"\nfrom robotree.kinds import {kind}\nfrom robotree.testing",
        )
    return {
        f"{module}.py": page,
        f"test_{module}.py": test,
        **_checkers(),
        ".vscode/settings.json": EDITOR,
    }
