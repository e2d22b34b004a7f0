"""An author without any robot: a page that is begun, checked, and told what is wrong with it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from robotree.tui.cli import main
from robotree.tui.rules import known_kinds
from robotree.vr.base.errors import BrokenSource
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.check import examine

KINDS = {"Arm": {"go_to": None, "get_info": None, "grip": known_kinds()["Arm"]["grip"]}}
HEADER = """\
import random, subprocess, time
from datetime import datetime
from time import sleep as rest
from typing import Annotated
from robotree.vr import Child, Unit, VirtualRobot, command, state

class Page(VirtualRobot):
    arm = Child("Arm")
    picked: int = state(0)
    seen: list[str] = state([])
    speed: float = 0.1
"""

PLACES = [
    ("self.count = 1", "self.count does not survive"),
    ("self.count += 1", "self.count does not survive"),
    ("self.last, self.picked = 1, 2", "self.last does not survive"),
    ("self.table['a'] = 1", "self.table does not survive"),
    ("self.names.append('a')", "self.names does not survive"),
    ("time.sleep(1)", "time.sleep holds the robot up"),
    ("rest(1)", "time.sleep holds the robot up"),
    ("input('go?')", "input may block"),
    ("self.arm.go_too(x=1)", "arm is of kind Arm, which has no command 'go_too'"),
]
"""Lines inside a command, and what is found in them."""


def found(body: str, mark: str = "@command") -> list[str]:
    source = f"{HEADER}\n    {mark}\n    def work(self) -> None:\n        {body}\n"
    return [f"{one.line}: {one.what}" for one in examine(source, KINDS)]


@pytest.mark.parametrize(("body", "what"), PLACES, ids=[body for body, _ in PLACES])
def test_a_line_with_a_mistake_is_found(body: str, what: str) -> None:
    (line,) = found(body)
    assert line.startswith(f"15: {what}")


NOT_REPEATED = [
    ("time.time()", "time.time is another one each time", "self.now()"),
    ("now = datetime.now()", "datetime.datetime.now is another one each time", "self.now()"),
    ("random.choice([1, 2])", "random.choice is another one each time", "self.random()"),
    ("import uuid; uuid.uuid4()", "uuid.uuid4 is another one each time", "self.context.key"),
    ("open('x').close()", "open asks the disk", "have a child's command do it"),
    ("from pathlib import Path; Path('x').read_text()", "read_text asks the disk", "a setting"),
    ("import os; os.getenv('HOME')", "os.getenv depends on where the host runs", "a setting"),
    ("from os import path; path.exists('x')", "os.path.exists asks the disk", "a setting"),
    (
        "import threading as t; t.Thread(target=print).start()",
        "threading.Thread runs beside",
        "self.together()",
    ),
    ("import zmq; zmq.Context()", "zmq.Context asks the network", "have a child's command do it"),
    ("for one in {1, 2}: print(one)", "a set is gone through in another order", "sorted(…)"),
    ("print([one for one in {1, 2}])", "a set is gone through in another order", "sorted(…)"),
    ("for one in set('ab'): print(one)", "a set is gone through in another order", "sorted(…)"),
]
"""Lines inside a command that a replay would not repeat, what is said of them, and what is to be written."""


def page_with(body: str, head: str = "", name: str = "work") -> str:
    return f"{head}{HEADER}\n    @command\n    def {name}(self) -> None:\n        {body}\n"


@pytest.mark.parametrize(("body", "what", "instead"), NOT_REPEATED, ids=[one[0] for one in NOT_REPEATED])
def test_a_line_that_a_replay_would_not_repeat_is_a_warning_with_what_to_write(
    body: str, what: str, instead: str
) -> None:
    (one,) = examine(page_with(body), KINDS)
    assert (one.line, one.level) == (15, "warning")
    assert one.what.startswith(what)
    assert instead in one.instead


def test_what_blocks_and_would_not_be_repeated_is_both() -> None:
    levels = [(one.level, one.what) for one in examine(page_with("subprocess.run(['ls'])"), KINDS)]
    assert [(level, what.partition(",")[0]) for level, what in levels] == [
        ("mistake", "subprocess.run may block"),
        ("warning", "subprocess.run runs a program"),
    ]


@pytest.mark.parametrize("name", ["readings", "safe_stop", "resume", "__init__"])
def test_where_no_command_runs_nothing_is_repeated(name: str) -> None:
    source = page_with("time.time()").replace("    @command\n", "").replace("work", name)
    assert not [one for one in examine(source, KINDS) if one.level == "warning"]


def test_what_lies_beside_a_page_travels_with_it_and_may_be_read() -> None:
    head = "import json\nfrom pathlib import Path\nMAP = Path(__file__).with_name('map.json')\n"
    assert examine(page_with("json.loads(MAP.read_text())", head), KINDS) == []
    assert examine(page_with("open(MAP).close()", head), KINDS) == []
    (one,) = examine(page_with("open('map.json').close()", head), KINDS)
    assert one.level == "warning"


def test_a_child_may_have_a_command_of_any_name() -> None:
    assert examine(page_with("print(self.any.read_text(), self._file.unlink())"), KINDS) == []


def test_warnings_are_printed_and_are_no_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.py"
    page.write_text(page_with("print(time.time())"))
    assert main(["check", str(page)]) == 0
    assert f"{page}:15: warning: time.time is another one each time" in capsys.readouterr().out
    assert main(["check", str(page), "--json"]) == 0
    (one,) = json.loads(capsys.readouterr().out)
    assert (one["line"], one["level"]) == (15, "warning")
    page.write_text(page_with("print(time.time()); time.sleep(1)"))
    assert main(["check", str(page)]) == 1


@pytest.mark.parametrize(
    "body",
    [
        "self.picked += 1",
        "self.seen.append('a')",
        "self.speed = 0.2",
        "self._cache = 1",
        "self.sleep(1)",
        "self.arm.go_to(x=1)",
        "self.arm.set(speed=1)",
        "self.arm.grip(action='open', within='5 s')",
        "local = []; local.append(1)",
        "print(self.now(), self.random())",
    ],
)
def test_what_is_right_is_left_alone(body: str) -> None:
    assert found(body) == []


def test_a_command_that_reads_and_changes_state_is_found() -> None:
    assert found("self.picked += 1", '@command(effect="read")') == [
        '15: work says effect="read" and changes self.picked'
    ]


@pytest.mark.parametrize(
    "body", ["self.arm = 3", "_, self.arm = 1, 2", "del self.arm", "for self.arm in (1, 2): pass"]
)
def test_a_slot_that_a_command_replaces_is_found_and_refused_by_a_host(body: str) -> None:
    (line,) = found(body)
    assert line == "15: self.arm is a slot, and this takes the child away"
    source = f"{HEADER}\n    @command\n    def work(self) -> None:\n        {body}\n"
    with pytest.raises(BrokenSource, match=r"line 15: self\.arm is a slot.*another name, such as self\._arm"):
        Bundle(source, "page.py").load()


def test_a_slot_that_a_derived_page_replaces_is_refused_too() -> None:
    more = "\nclass More(Page):\n    @command\n    def more(self) -> None:\n        self.arm = 3\n"
    with pytest.raises(BrokenSource, match=r"self\.arm is a slot"):
        Bundle(HEADER + more, "page.py", "More").load()
    own = more.replace("(Page):", "(Page):\n    arm = None")
    (one,) = examine(HEADER + own, KINDS)
    assert one.what == "self.arm does not survive a reload"


@pytest.mark.parametrize(
    ("line", "hook"),
    [
        ("def safe_stopp(self, reason): ...", "safe_stop(reason)"),
        ("def on_release(self): ...", "resume()"),
        ("def reading(self): return {}", "readings()"),
        ('begin = "work"', "begins"),
    ],
)
def test_a_misspelled_hook_is_found_unless_the_page_uses_the_name(line: str, hook: str) -> None:
    source = f"{HEADER}\n    {line}\n"
    (one,) = examine(source, KINDS)
    name = line.replace("def ", "").partition("(")[0].partition(" ")[0]
    verb = "calls" if line.startswith("def") else "reads"
    assert (one.line, one.what, one.instead) == (13, f"nothing {verb} {name}", f"did you mean {hook}?")
    assert examine(f"{source}\n    def other(self):\n        return self.{name}\n", KINDS) == []
    assert examine(source.replace(name, hook.partition("(")[0]), KINDS) == []


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("get_inf = arm.exposed()", "13: arm is of kind Arm, which has no command 'get_inf'"),
        ('info = arm.exposed("get_inf")', "13: arm is of kind Arm, which has no command 'get_inf'"),
        ('wide: Annotated[float, Unit("metrs")] = 1.0', "13: "),
        ("slowness: float", "13: slowness has a type and no value, so that it is no setting"),
    ],
)
def test_what_the_class_promises_wrongly_is_found(line: str, what: str) -> None:
    (one,) = examine(f"{HEADER}\n    {line}\n", KINDS)
    assert f"{one.line}: {one.what}".startswith(what)


def test_a_type_of_what_the_constructor_sets_is_left_alone() -> None:
    lines = "    low: float\n    def __init__(self, name: str) -> None:\n        self.low = 1.0\n"
    assert examine(f"{HEADER}\n{lines}", KINDS) == []


def test_a_derived_page_knows_what_its_base_declares() -> None:
    source = (
        f"{HEADER}\nclass More(Page):\n    @command\n    def more(self) -> None:\n        self.picked += 1\n"
    )
    assert examine(source, KINDS) == []


def test_check_prints_file_line_and_what_to_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    page = f"{HEADER}\n    @command\n    def work(self) -> None:\n        time.sleep(1)\n"
    Path("page.py").write_text(page)
    assert main(["check", "page.py"]) == 1
    assert capsys.readouterr().out == (
        "page.py:15: time.sleep holds the robot up: "
        "write self.sleep(seconds): a cancel and a stop end it at once\n"
    )
    assert main(["check", "page.py", "--json"]) == 1
    (one,) = json.loads(capsys.readouterr().out)
    assert (one["file"], one["line"]) == ("page.py", 15)
    Path("page.py").write_text(page + "  nonsense")
    assert main(["check", "page.py"]) == 1
    assert capsys.readouterr().out.startswith("page.py:16: ")
    Path("page.py").write_text(page.replace("time.sleep(1)", "self.sleep(1)").replace("= 0.1", '= "a"'))
    assert main(["check", "page.py"]) == 1
    assert "a host refuses the page like this" in capsys.readouterr().out
    Path("page.py").write_text(page + "\n    def __init__(self):\n        super().__init__()\n")
    assert main(["check", "page.py"]) == 1
    assert "Page.__init__ must take the robot's name" in capsys.readouterr().out


@pytest.mark.parametrize("over", [[], ["--over", "arm"]])
def test_a_new_page_passes_its_check_and_nothing_is_overwritten(
    over: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my-team", *over]) == 0
    said = capsys.readouterr().out
    assert "robotree check my_team.py" in said
    assert "robotree create my_team.py as my-team" in said
    assert main(["check", "my_team.py"]) == 0
    compile(Path("test_my_team.py").read_text(), "test_my_team.py", "exec")
    places = json.loads(Path("pyrightconfig.json").read_text()).get("extraPaths", [])
    assert all((Path(place) / "robotree" / "kinds" / "arm.py").is_file() for place in places)
    assert ("from robotree.kinds import Arm" in Path("my_team.py").read_text()) == bool(over)
    json.loads(Path(".vscode/settings.json").read_text())
    Path("my_team.py").write_text("mine")
    assert main(["new", "my-team"]) != 0
    assert Path("my_team.py").read_text() == "mine"


@pytest.mark.parametrize("there", [True, False])
def test_a_new_page_says_what_its_test_needs(
    there: bool,  # noqa: FBT001 # a parameter
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    if not there:
        monkeypatch.setitem(sys.modules, "pytest", None)
    assert main(["new", "mine"]) == 0
    steps = capsys.readouterr().out.partition("next:\n")[2].split("\n")
    assert ("robotree[testing]" in "".join(steps)) == (not there)
    assert "  pytest test_mine.py" in steps


@pytest.mark.parametrize("words", [["new", "1st"], ["new", "wave"], ["new", "team", "--over", "whale"]])
def test_a_page_that_cannot_be_begun_is_refused(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) != 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "deep",
    ["(" * 100_000, "[" * 100_000, "-" * 100_000 + "1", "not " * 100_000 + "1", "1" + " + 1" * 100_000],
    ids=["(", "[", "-", "not", "+"],
)
def test_a_page_that_is_nested_too_deeply_is_refused_by_the_check_and_by_a_host(
    deep: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "deep.py"
    page.write_text(f"x = {deep}\n")
    assert main(["check", str(page)]) == 1
    said = capsys.readouterr()
    assert said.out.startswith(f"{page}:")
    assert " nested " in said.out
    assert said.out.count("\n") == 1
    assert said.err == ""
    with pytest.raises(BrokenSource, match="nested"):
        Bundle.read(page).load()


@pytest.mark.parametrize("name", ["guide.yaml", "guide.YML", "guide.clp"])
def test_the_check_of_pages_names_the_check_of_scripts(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / name
    script.write_text("script: guide\n")
    assert main(["check", str(script)]) == 2
    said = capsys.readouterr()
    assert f"is a script, not a page; check it with `robotree rules check {script}`" in said.err
    assert said.out == ""


@pytest.mark.parametrize(
    ("made", "what"),
    [("open('log')", "an open file"), ("threading.Lock()", "a lock"), ("socket.socket()", "a socket")],
)
def test_what_keeps_a_robot_in_its_process_is_named_by_check(made: str, what: str) -> None:
    page = f"""import socket
import threading

from robotree.vr import VirtualRobot, command


class Tied(VirtualRobot):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._kept = {made}

    @command
    def use(self) -> None:
        made = {made}
"""
    said = f"self._kept is {what}: the robot cannot move to another host"
    assert [(one.line, one.what) for one in examine(page, {}) if "move" in one.what] == [(10, said)]


PAGE = '''from robotree.vr import VirtualRobot, command

class Walker(VirtualRobot):
    @command
    def walk(self, steps: int = 1) -> None:
        """Walk."""
'''

BAD_PANELS = {
    "walker.panel.yaml": (
        ("parts:\n  - form: jump\n", 1, "Walker has no command 'jump'"),
        ("title: Walk\nparts:\n  - buton: walk\n", 3, "there is no part 'buton'"),
        ("parts:\n  - button: walk\n    arguments: {steps: many}\n", 1, "steps"),
    ),
    "walker.panel.py": (("class Panel(\n", 1, "was never closed"),),
}
"""By file: what stands in it, the line that is named, and words of what is found."""


@pytest.mark.parametrize(
    ("file", "text", "line", "words"),
    [(file, *panel) for file, panels in BAD_PANELS.items() for panel in panels],
)
def test_a_panel_that_would_not_be_shown_is_found_with_its_page(
    file: str, text: str, line: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "walker.py"
    page.write_text(PAGE)
    (tmp_path / file).write_text(text)
    assert main(["check", str(page)]) == 1
    printed = capsys.readouterr().out
    assert printed.startswith(f"{tmp_path / file}:{line}: ")
    assert words in printed


@pytest.mark.parametrize("page", ["move_square", "patrol", "teleop"])
def test_the_panels_of_the_examples_are_shown(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", f"examples/{page}.py"]) == 0
    assert "panel" not in capsys.readouterr().out
