"""docs/nbsa.md names a test for each concept, row and figure of the paper: each of them is there."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "nbsa.md").read_text()


def test_each_test_that_the_page_names_is_there() -> None:
    sources = "\n".join(path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    words = re.findall(r"`((?:tests/|test_)[^`]+)`", PAGE)
    missing = [
        word
        for word in words
        if not ((ROOT / word).exists() if word.startswith("tests/") else re.search(rf"def {word}\(", sources))
    ]
    assert len(words) > 30
    assert missing == []


def test_each_row_has_what_shows_it() -> None:
    rows = [line for line in PAGE.splitlines() if line.startswith("| ") and not line.startswith("|--")]
    heads = ("| concept ", "| row ", "| property ", "| figure ")
    bare = [row for row in rows if not row.startswith(heads) and "`" not in row.split("|")[-2]]
    assert bare == []
    assert "*open*" not in PAGE.lower()
