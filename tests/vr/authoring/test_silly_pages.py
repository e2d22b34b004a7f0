"""The silliest pages: what a host says of each and what `robotree check` finds is written below it."""

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
    sentence = r"Sly\.arm is a slot.*such as self\._arm \(test_silly_pages\.py, line"
    with pytest.raises(CommandFailed, match=sentence):
        team.call("take", name="arm")
    assert team.describe().slots[0].child is not None


def test_a_default_that_code_changes_is_a_new_one_in_each_call() -> None:
    team = rehearse(Sly)
    assert [team.call("collect", number=1), team.call("collect", number=2)] == [1, 1]
    assert team.call("collect", number=1, numbers=[1.0, 2.0]) == 3
