"""Pages to choose from: what a source offers is seen without running it, and packages offer pages."""

from __future__ import annotations

import hashlib
import json
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.cli import main
from robotree.tui.errors import ValueRefused
from robotree.tui.line import sources
from robotree.tui.screen.pages.new import places
from robotree.tui.screen.source_outline import outline, suggested_name
from robotree.vr.base.address import check_name

EXAMPLES = Path(__file__).parents[2] / "examples"
PAGES = sorted(path for path in EXAMPLES.glob("[a-z]*.py") if not path.name.endswith(".panel.py"))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_every_example_offers_a_robot_with_commands_and_a_documentation(path: Path) -> None:
    (found,) = [one for one in outline(path.read_text()) if one.commands][-1:]
    assert found.doc
    assert found.slots


def test_slots_commands_and_heirs_are_found() -> None:
    source = """
import vr
boom = 1 / 0
class Base(vr.VirtualRobot):
    "A base."
    arm = vr.Child("Arm", "the arm")
    move = arm.exposed()
    @vr.command(effect="repeat")
    def close(self) -> None: ...
    def helper(self) -> None: ...
class Heir(Base): ...
class Other: ...
"""
    base, heir = outline(source)
    assert (base.name, base.doc) == ("Base", "A base.")
    assert base.slots == (("arm", "Arm"),)
    assert base.commands == ("move", "close")
    assert heir.name == "Heir"


def test_settings_are_read_without_running_the_source() -> None:
    source = """
from typing import Annotated, Literal
from robotree.vr import Range, Unit, VirtualRobot, state
Speed = Annotated[float, Unit("m/s"), Range(0.01, upper=0.3), "how quickly it goes"]
class Base(VirtualRobot):
    speed: Speed = 0.1
    hand: Literal["left", "right"] = "left"
    picked: int = state(0)
    _hidden: int = 1
    table: dict[str, int] = {}
    many: "int" = 3
    unknown: Somewhere = 4
    plain = 5
class Heir(Base):
    speed: Speed = 0.2
    label: str | None = None
"""
    base, heir = outline(source)
    assert [(setting.name, setting.type, setting.default) for setting in base.settings] == [
        ("speed", "float", 0.1),
        ("hand", "choice", "left"),
        ("many", "int", 3),
    ]
    speed = base.settings[0]
    assert (speed.unit, speed.lower, speed.upper, speed.doc) == ("m/s", 0.01, 0.3, "how quickly it goes")
    assert [(setting.name, setting.default) for setting in heir.settings] == [
        ("speed", 0.2),
        ("hand", "left"),
        ("many", 3),
        ("label", None),
    ]


def test_a_file_without_a_robot_offers_nothing_and_no_python_is_told() -> None:
    assert outline("x = 1") == []
    with pytest.raises(SyntaxError):
        outline("def")


@given(
    name=st.text("ABcdXyz_0", min_size=1, max_size=30).filter(
        lambda text: text.isidentifier() and text[0] != "_"
    ),
    taken=st.sets(st.sampled_from(["a", "x", "y", "z", "b", "a-2", "x-2"])),
)
def test_a_suggested_name_can_be_a_name_and_is_free(name: str, taken: set[str]) -> None:
    found = suggested_name(name, frozenset(taken))
    assert check_name(found) == found
    assert found not in taken


def test_a_suggested_name_reads_well() -> None:
    assert suggested_name("OpenCloseLever", frozenset()) == "open-close-lever"
    assert suggested_name("MoveTo", frozenset({"move-to"})) == "move-to-2"


def test_an_enum_a_tuple_and_a_constant_are_read_without_running_the_source() -> None:
    source = """
class Side(Enum):
    LEFT = "left"
    RIGHT = "right"
SLOW = 0.1
class Team(VirtualRobot):
    side: Side = Side.RIGHT
    home: Annotated[tuple[float, float], Unit("m")] = (0.3, 0.1)
    names: tuple[str, ...] = ()
    speed: float = SLOW
"""
    (team,) = outline(source)
    assert [(setting.name, setting.type, setting.default, setting.choices) for setting in team.settings] == [
        ("side", "choice", "right", ("left", "right")),
        ("home", "tuple", [0.3, 0.1], ()),
        ("names", "list", [], ()),
        ("speed", "float", 0.1, ()),
    ]


# -- a package offers pages by entry points: a real wheel, unpacked into a folder at which Python looks

PAGE = '''"""Patrol: from place to place."""

raise_if_imported = __name__.startswith("acme")
if raise_if_imported:
    raise RuntimeError("listing must run nothing of a package")

from robotree.vr import VirtualRobot, command

from acme_helper import ROUNDS


class Patrol(VirtualRobot):
    """Goes from place to place."""

    @command
    def rounds(self) -> int:
        """Say how many rounds it goes."""
        return ROUNDS


class Guard(Patrol):
    """Stays."""
'''
FILES = {
    "acme/__init__.py": "raise RuntimeError('listing must run nothing of a package')\n",
    "acme/pages/__init__.py": "raise RuntimeError('listing must run nothing of a package')\n",
    "acme/pages/patrol.py": PAGE,
    "acme/pages/acme_helper.py": "ROUNDS = 7\n",
    "acme/pages/patrol.panel.yaml": "title: Patrol\nparts:\n  - form: rounds\n",
    "acme/night.yaml": "rules: []\n",
    "acme_pages-1.2.dist-info/METADATA": "Metadata-Version: 2.1\nName: acme-pages\nVersion: 1.2\n",
    "acme_pages-1.2.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    "acme_pages-1.2.dist-info/entry_points.txt": (
        "[robotree.pages]\n"
        "patrol = acme.pages.patrol:Patrol\n"
        "guard = acme.pages.patrol:Guard\n"
        "night = acme:night.yaml\n"
        "gone = acme.none\n"
    ),
}


@pytest.fixture
def acme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A wheel, unpacked as an installer does, whose folder Python looks at."""
    wheel, site = tmp_path / "acme_pages-1.2-py3-none-any.whl", tmp_path / "site"
    record = "".join(
        f"{name},sha256={hashlib.sha256(text.encode()).hexdigest()},\n" for name, text in FILES.items()
    )
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in {**FILES, "acme_pages-1.2.dist-info/RECORD": record}.items():
            archive.writestr(name, text)
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    monkeypatch.syspath_prepend(site)
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    yield site
    assert not [name for name in sys.modules if name.partition(".")[0] == "acme"]


def test_pages_of_packages_are_listed_and_nothing_of_them_runs(
    acme: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new"]) == 0
    said = capsys.readouterr().out
    assert f"patrol           acme-pages 1.2           {acme / 'acme/pages/patrol.py'}" in said
    assert "gone             acme-pages 1.2           acme.none, which is not there" in said
    assert main(["new", "--json"]) == 0
    listed = {one["name"]: one for one in json.loads(capsys.readouterr().out)}
    assert listed["guard"]["wanted"] == "Guard"
    assert listed["night"]["file"] == str(acme / "acme/night.yaml")
    assert ("acme-pages 1.2", acme / "acme/pages") in places()  # where the screen offers to begin


def test_a_line_names_a_page_of_a_package_as_it_names_a_file(acme: Path) -> None:
    patrol = str(acme / "acme/pages/patrol.py")
    assert sources.found("patrol") == (patrol, "Patrol")
    assert sources.found("patrol:Guard") == sources.found("guard") == (patrol, "Guard")
    assert sources.found("team.py:Team") == ("team.py", "Team")
    Path("patrol").write_text("")  # a file goes first
    assert sources.found("patrol") == ("patrol", "")
    with pytest.raises(ValueRefused, match="no page of that name: packages offer gone, guard, night, patrol"):
        sources.found("nonsense")
    with pytest.raises(ValueRefused, match=r"'gone' at acme\.none, and nothing is there"):
        sources.found("gone")


def test_two_packages_of_one_name_are_not_chosen_between(acme: Path) -> None:
    other = acme / "other_pages-1.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: other-pages\nVersion: 1\n")
    (other / "entry_points.txt").write_text("[robotree.pages]\npatrol = acme.pages.patrol:Guard\n")
    with pytest.raises(ValueRefused, match="several packages offer 'patrol'"):
        sources.found("patrol")


@pytest.mark.usefixtures("acme")
def test_a_page_of_ones_own_begins_with_one_of_a_package(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["check", "guard"]) == 0
    capsys.readouterr()
    assert main(["new", "mine", "--from", "patrol"]) == 0
    assert "robotree create mine.py:Patrol as mine" in capsys.readouterr().out
    assert sorted(path.name for path in Path().iterdir()) == ["acme_helper.py", "mine.panel.yaml", "mine.py"]
    assert main(["check", "mine.py:Patrol"]) == 0
    assert main(["new", "mine", "--from", "guard"]) != 0
    assert "is there already; nothing was written" in capsys.readouterr().err
