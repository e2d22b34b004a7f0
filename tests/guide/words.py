"""The words of the guides, without fenced blocks (programs) and without decisions and generated pages."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
GUIDES = [*sorted(DOCS.glob("*.md")), *sorted((DOCS / "guide").glob("*.md"))]


def words_of(text: str) -> int:
    """Count what has a letter or a digit; fences come in pairs, so every second part is outside of them."""
    outside = "".join(re.split(r"^```", text, flags=re.MULTILINE)[::2])
    return sum(any(map(str.isalnum, word)) for word in outside.split())


def words_of_guides() -> int:
    """Count the words of all guides."""
    return sum(words_of(path.read_text(encoding="utf-8")) for path in GUIDES)
