"""Pages with mistakes: each is refused with page, line, what is wrong and what to write instead."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from robotree.kinds import Arm
from robotree.testing import Fake, rehearse
from robotree.tui.line.findings import findings
from robotree.tui.line.known_kinds import known_kinds
from robotree.vr import Child, CommandFailed, VirtualRobot, command
from robotree.vr.base.errors import BundleError
from robotree.vr.bundle import Bundle

HEAD = """from dataclasses import dataclass
from enum import Enum
from typing import Annotated
from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command

class Team(VirtualRobot):
    arm = Child("Arm")
"""
"""Seven lines: the mistakes stand in line 8 or below."""

MISTAKES = {
    "a unit that nobody knows": (
        '    @command\n    def go(self, x: Annotated[float, Unit("metrs")]) -> None: ...\n',
        "line 9: the unit 'metrs' is not known; the nearest is 'm'",
    ),
    "a unit of a reading": (
        '    reading_units = {"height": "metrs"}\n',
        "line 6: the unit 'metrs' is not known; the nearest is 'm'",
    ),
    "an empty range": (
        "    @command\n    def go(self, x: Annotated[float, Range(1, 0)]) -> None: ...\n",
        "line 9: a range from 1 to 0 is empty",
    ),
    "a list of Child": (
        '    rovers = [Child("Rover"), Child("Rover")]\n',
        "line 8: Team.rovers is a list of Child, which makes no slots; write: rovers = Children(",
    ),
    "an array of impossible size": (
        '    rovers = Children("Rover", least=3, most=2)\n',
        "line 8: Children('Rover', least=3, most=2): `least` is 0 or more, `most` at least that, and from 1",
    ),
    "a kind that is none": (
        "    other = Child(int)\n",
        "line 8: int is no kind; import one from robotree.kinds, write one with `robotree stubs NAME`",
    ),
    "a command named like a robot's method": (
        "    @command\n    def sleep(self) -> None: ...\n",
        "line 9: Team.sleep: a command cannot have this name; every robot uses it itself",
    ),
    "a helper named like a robot's method": (
        "    def progress(self) -> None: ...\n",
        "line 8: Team.progress: it cannot have this name; every robot uses it itself",
    ),
    "a command with a text": (
        "    @command('go')\n    def go(self) -> None: ...\n",
        "line 8: a command has the name of its method; write @command without a text",
    ),
    "a slot without a kind": (
        "    other = Child\n",
        'line 8: Team.other is Child without a kind; write: other = Child("Arm")',
    ),
    "exposed without parentheses": (
        "    go_to = arm.exposed\n",
        "line 8: Team.go_to is arm.exposed without parentheses; write: go_to = arm.exposed()",
    ),
    "a setting with a comma too many": (
        "    speed: float = 0.1,\n",
        "line 8: default of Team: speed: [0.1] is not a number",
    ),
    "a missing annotation": (
        "    @command\n    def go(self,\n        x): ...\n",
        "line 10: Team.go: parameter 'x' needs a type: float, int, bool, str",
    ),
    "a list of anything": (
        "    @command\n    def go(self, x: list) -> None: ...\n",
        "line 9: Team.go: parameter 'x' does not say what is in it: write for example list[float]",
    ),
    "an Enum of numbers": (
        "    class Side(Enum):\n        LEFT = 1\n    @command\n    def go(self, x: Side) -> None: ...\n",
        "line 11: Team.go: parameter 'x': Side.LEFT is 1; write a text: LEFT = \"left\"",
    ),
    "a default out of range": (
        "    @command\n    def go(self, x: Annotated[float, Range(0, 1)] = 2) -> None: ...\n",
        "line 9: default of Team.go: x: 2 is out of range; give a number from 0 to 1",
    ),
    "exposed of an unknown slot": (
        "    move = rover.exposed()\n",
        "line 8: no slot 'rover'; the slots above it are: arm",
    ),
    "exposed of a command that the kind lacks": (
        "    from robotree.kinds import Rover\n    rover = Child(Rover)\n    fly = rover.exposed()\n",
        "line 10: Team.fly: rover is of kind Rover, which has no command 'fly'; it has: get_info, halt, move",
    ),
    "a hook that is async": (
        "    async def readings(self): ...\n",
        "line 8: Team.readings runs in a thread: write it without async",
    ),
    "a command that is async": (
        "    @command\n    async def go(self) -> None: ...\n",
        "line 9: Team.go: write it without async; a command has a thread of its own and may block",
    ),
    "a command that yields": (
        "    @command\n    def go(self):\n        yield 1\n",
        "line 9: Team.go: a command cannot yield; return a list, and tell steps with self.progress(part",
    ),
    "a command that is async and yields": (
        "    @command\n    async def go(self):\n        yield 1\n",
        "line 9: Team.go: a command cannot yield; return a list",
    ),
    "a command without self": (
        "    @command\n    def go() -> None: ...\n",
        "line 9: Team.go: the first parameter of a command is self; write def go(self, …)",
    ),
    "a command whose first parameter is not self": (
        "    @command\n    def go(x: float) -> None: ...\n",
        "line 9: Team.go: the first parameter of a command is self; write def go(self, …)",
    ),
    "a command that is a property": (
        "    @property\n    @command\n    def go(self) -> int: ...\n",
        "line 10: Team.go: a command is a plain method; take @property away",
    ),
    "a property that is a command": (
        "    @command\n    @property\n    def go(self) -> int: ...\n",
        "line 8: a command is a plain method; take @property away",
    ),
    "a command that is static": (
        "    @staticmethod\n    @command\n    def go(x: int) -> int: ...\n",
        "line 10: Team.go: a command is a plain method; take @staticmethod away",
    ),
    "a command of the class": (
        "    @command\n    @classmethod\n    def go(cls, x: int) -> int: ...\n",
        "line 8: a command is a plain method; take @classmethod away",
    ),
    "an effect that nobody knows": (
        "    @command(effect='raed')\n    def go(self) -> int: ...\n",
        "line 9: Team.go: no effect 'raed'; write one of 'read', 'repeat', 'once'",
    ),
    "a range of texts": (
        "    @command\n    def go(self, x: Annotated[float, Range('0', '1')]) -> None: ...\n",
        "line 9: Range('0', '1'): its bounds are numbers, or None",
    ),
    "a unit that is no text": (
        "    @command\n    def go(self, x: Annotated[float, Unit(1)]) -> None: ...\n",
        "line 9: Unit(1): a unit is a text, such as Unit('m')",
    ),
    "a unit instead of a type": (
        "    @command\n    def go(self, x: Unit('m')) -> None: ...\n",
        "line 9: Team.go: parameter 'x' cannot be Unit('m'): write Annotated[float, Unit('m')]",
    ),
    "an array of numpy as a type": (
        "    import numpy as np\n    @command\n    def go(self, x: np.ndarray) -> None: ...\n",
        "line 10: Team.go: parameter 'x' cannot be ndarray: write list[float]",
    ),
    "a number of numpy as a type": (
        "    import numpy as np\n    @command\n    def go(self, x: np.float64) -> None: ...\n",
        "line 10: Team.go: parameter 'x' cannot be float64: write float, int or bool; numpy's are taken",
    ),
    "a NamedTuple": (
        "    from collections import namedtuple as nt\n    @command\n    def f(self, p: nt('P', 'x')): 0\n",
        "line 10: Team.f: parameter 'p' cannot be P: write a dataclass instead of a NamedTuple",
    ),
    "a set": (
        "    @command\n    def go(self, x: set[int]) -> None: ...\n",
        "line 9: Team.go: parameter 'x' cannot be set[int]: write list[…]",
    ),
    "a slot that is only annotated": (
        '    other: Child("Arm")\n',
        "line 8: Team.other is only annotated; write: other = Child(…), with an =",
    ),
    "a slot named like what each robot has": (
        '    name = Child("Arm")\n',
        "line 8: Team.name: it cannot have this name; every robot uses it itself",
    ),
    "numbers of children that are not named": (
        '    rovers = Children("Rover", 4)\n',
        "line 8: 4 says nothing about the children; write least=… and most=… by name",
    ),
    "a constructor without a name": (
        "    def __init__(self):\n        super().__init__()\n",
        "line 8: Team.__init__ must take the robot's name and nothing else: write def __init__(self",
    ),
    "a constructor that takes more": (
        "    def __init__(self, name, port):\n        super().__init__(name)\n",
        "line 8: Team.__init__ must take the robot's name and nothing else: write def __init__(self",
    ),
    "a constructor that makes a slot": (
        "    def __init__(self, name):\n        super().__init__(name)\n        self.other = Child('Arm')\n",
        "line 8: Team.__init__ sets self.other to a Child, which makes no slot; write other = Child('Arm')",
    ),
    "a constructor that fails": (
        "    def __init__(self, name):\n        super().__init__(name)\n        self.x = 1 / 0\n",
        "line 10: ZeroDivisionError: division by zero",
    ),
    "a robot that is a dataclass": (
        "\n@dataclass\nclass Team(Team):\n    speed: float = 1.0\n",
        "line 6: Team.__init__ is that of a dataclass: take @dataclass away; settings are attributes with a",
    ),
    "a syntax error": ("    def go(self:\n", "line 8: "),
    "an import that fails": (
        "\nimport nowhere_at_all\n",
        "line 9: ModuleNotFoundError: No module named 'nowhere_at_all'",
    ),
    "a name that is not there": (
        "    @command\n    def go(self, x: 'Metre') -> None: ...\n",
        "line 9: Team.go: name 'Metre' is not defined; define it in the file, outside of functions",
    ),
    "an error while it is loaded": ("\nTABLE = {}['door']\n", "line 9: KeyError: 'door'"),
}


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda name: name.replace(" ", "-"))
def test_a_page_with_a_mistake_is_refused_with_its_line_and_the_remedy(mistake: str) -> None:
    lines, said = MISTAKES[mistake]
    with pytest.raises(BundleError) as refused:
        Bundle(HEAD + lines, "team.py").create("team")
    assert str(refused.value).startswith(f"team.py cannot be loaded: {said}")


# -- the silliest pages: what a host says of each and what `robotree check` finds is written below it


PAGES = sorted(Path(__file__).with_name("silly_pages").glob("*.py"))
GUIDE = Path(__file__).parents[3] / "docs" / "guide"
EXAMPLES = Path(__file__).parents[3] / "examples"
EXPECTED = re.compile(r"^# (host|check): (.*)$", re.MULTILINE)
DOCUMENTED = re.compile(r"^```python (?P<name>[\w./]+)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)


def expected(page: Path, who: str) -> list[str]:
    """Return what somebody says of a page, as it stands below the page."""
    return [text for name, text in EXPECTED.findall(page.read_text()) if name == who]


def said_by_a_host(page: Path) -> list[str]:
    try:
        Bundle.read(page).create("team")
    except BundleError as error:
        return [str(error.data["reason"])]
    return []


def found_by_check(bundle: Bundle) -> list[str]:
    return [
        f"line {finding.line}: {finding.what}: {finding.instead}"
        for finding in findings(bundle, known_kinds())
    ]


def test_there_are_at_least_twenty_silly_pages() -> None:
    assert len(PAGES) >= 20
    assert all(expected(page, "check") for page in PAGES)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_host_refuses_a_silly_page_with_its_line(page: Path) -> None:
    assert said_by_a_host(page) == expected(page, "host")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_check_finds_a_silly_page_with_its_line(page: Path) -> None:
    assert found_by_check(Bundle.read(page)) == expected(page, "check")


@pytest.mark.parametrize("chapter", sorted(GUIDE.glob("*.md")), ids=lambda chapter: chapter.stem)
def test_check_accepts_what_the_guide_writes(
    chapter: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found: dict[str, list[str]] = {}
    for block in DOCUMENTED.finditer(chapter.read_text()):
        name = block["name"]
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(block["body"])
        if "VirtualRobot)" in block["body"]:
            found[name] = found_by_check(Bundle.read(name))
    assert not any(found.values()), found


@pytest.mark.parametrize(
    "page",
    sorted(page for page in EXAMPLES.glob("[!_]*.py") if not page.name.endswith(".panel.py")),
    ids=lambda page: page.stem,
)
def test_check_accepts_the_examples(page: Path) -> None:
    assert found_by_check(Bundle.read(page)) == []


# -- what only a running page shows ----------------------------------------------------------------


class Sly(VirtualRobot):
    """Sets its slot by a name that no reader of the page sees."""

    arm = Child("Arm")

    @command
    def take(self, name: str) -> None:
        """Set an attribute."""
        setattr(self, name, 3)

    @command
    def collect(self, number: float, numbers: list[float] = []) -> int:  # noqa: B006 # what is tested
        """Add a number to a list that is not given."""
        numbers.append(number)
        return len(numbers)


def test_a_slot_that_is_set_by_its_name_fails_with_the_line_and_keeps_its_child() -> None:
    team = rehearse(Sly, arm=Fake(Arm))
    sentence = r"Sly\.arm is a slot.*such as self\._arm \(test_mistakes\.py, line"
    with pytest.raises(CommandFailed, match=sentence):
        team.call("take", name="arm")
    assert team.describe().slots[0].child is not None


def test_a_default_that_code_changes_is_a_new_one_in_each_call() -> None:
    team = rehearse(Sly)
    assert [team.call("collect", number=1), team.call("collect", number=2)] == [1, 1]
    assert team.call("collect", number=1, numbers=[1.0, 2.0]) == 3
