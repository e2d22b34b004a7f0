"""The documents run: what they show is what there is, and what they name."""

from __future__ import annotations

import ast
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


# -- docs/nbsa.md names a test for each concept, row and figure of the paper ----------------------

NBSA = (ROOT / "docs" / "nbsa.md").read_text()


def test_each_test_that_the_page_names_is_there() -> None:
    words = re.findall(r"`((?:tests/|test_)[^`]+)`", NBSA)
    sources = "\n".join(path.read_text() for word in words if (path := ROOT / word).is_file())
    missing = [
        word
        for word in words
        if not ((ROOT / word).exists() if word.startswith("tests/") else re.search(rf"def {word}\(", sources))
    ]
    assert len(words) > 30
    assert missing == []


def test_each_row_has_what_shows_it() -> None:
    rows = [line for line in NBSA.splitlines() if line.startswith("| ") and not line.startswith("|--")]
    heads = ("| concept ", "| row ", "| property ", "| figure ")
    bare = [row for row in rows if not row.startswith(heads) and "`" not in row.split("|")[-2]]
    assert bare == []
    assert "*open*" not in NBSA.lower()


# -- the walks of CONTRIBUTING name files, and classes and functions in them ----------------------

WALKS = (ROOT / "CONTRIBUTING.md").read_text().partition("\n## Walks\n")[2].partition("\n## ")[0]
FILE = re.compile(r"`([\w./]+\.py)`(?:: |, )?")
NAME = re.compile(r"`([A-Z]\w+(?:\.\w+)?|[a-z_]+)`")
MADE_BY_THE_WALK = {"proxy/conveyor.py", "kinds/conveyor.py"}


def defined(path: Path) -> set[str]:
    """Return what a file defines at its top, and the methods of its classes as `Class.method`."""
    found = set[str]()
    for node in ast.parse(path.read_text()).body:
        match node:
            case ast.ClassDef():
                found |= {node.name}
                methods = [
                    each for each in node.body if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)
                ]
                found |= {f"{node.name}.{each.name}" for each in methods}
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                found.add(node.name)
            case ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                found.add(name)
            case _:
                pass
    return found


def test_every_file_of_a_walk_is_there() -> None:
    named = set(FILE.findall(WALKS)) - MADE_BY_THE_WALK
    assert len(named) > 30
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_every_class_and_method_of_a_walk_is_in_one_of_its_files() -> None:
    places = [ROOT / name for name in set(FILE.findall(WALKS)) - MADE_BY_THE_WALK]
    there = set[str]().union(*map(defined, places))
    named = {name for name in NAME.findall(WALKS) if name[0].isupper() and (name in there or "." in name)}
    assert len(named) > 40
    assert sorted(named - there) == []


def test_what_stands_behind_a_file_is_in_that_file() -> None:
    pairs = re.findall(r"`([\w./]+\.py)`: `([A-Za-z_]\w*(?:\.\w+)?)`", WALKS)
    assert len(pairs) > 35
    assert [pair for pair in pairs if pair[1] not in defined(ROOT / pair[0])] == []
