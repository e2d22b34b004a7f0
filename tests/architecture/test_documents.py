"""The documents run: what they show is what there is."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from robotree.tui.line import grammar
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.manual import EVERYWHERE
from robotree.tui.session.script import read
from tests.guide.words import GUIDES, words_of_guides

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *GUIDES]


def blocks(path: Path, language: str) -> list[str]:
    """Return the fenced blocks of a language; fences come in pairs, so every second part is one."""
    parts = re.split(r"^```", path.read_text(), flags=re.MULTILINE)[1::2]
    return [body for head, _, body in (part.partition("\n") for part in parts) if head == language]


def headings(path: Path) -> set[str]:
    """Return the names by which GitHub links to the headings of a page."""
    outside = "".join(re.split(r"^```", path.read_text(), flags=re.MULTILINE)[::2])
    found = re.findall(r"^#+ (.*)$", outside, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_link_leads_somewhere(path: Path) -> None:
    for target, heading in re.findall(r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", path.read_text()):
        page = path.parent / target if target else path
        assert page.exists(), target
        assert not heading or heading in headings(page), f"{target}#{heading}"


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_every_command_line_is_understood(path: Path) -> None:
    for block in (*blocks(path, ""), *blocks(path, "sh")):
        for line in block.splitlines():
            if line.startswith("robotree "):
                words = grammar.split(re.split(r"\s{3,}| \| | > | &$| &? +# ", line)[0])
                assert grammar.parse(words[1:] or ["supervise"], shapes(Where.SHELL), EVERYWHERE).verb


def test_the_pages_of_the_reference_are_made_from_what_the_program_uses() -> None:
    made: dict[str, str] = runpy.run_path(str(ROOT / "docs" / "reference.py"))["pages"]()
    there = {path.name: path.read_text() for path in (ROOT / "docs" / "reference").iterdir()}
    assert there.keys() == made.keys(), "run `python docs/reference.py`"
    assert [name for name in made if made[name] != there[name]] == [], "run `python docs/reference.py`"


def test_the_guides_have_at_most_35000_words() -> None:
    assert words_of_guides() <= 35_000, "say it once, and link to it (`python bench/house.py words`)"


def test_the_readme_shows_the_example_as_it_is() -> None:
    (page,) = blocks(ROOT / "README.md", "python")
    assert page == (ROOT / "examples" / "move_square.py").read_text()


def test_the_guide_s_session_is_understood() -> None:
    script = next(block for block in blocks(ROOT / "docs" / "operating.md", "") if "expect" in block)
    assert len(read(script, "operating.md").steps) == 6
