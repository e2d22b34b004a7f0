"""Writes the tables of verbs and keys in `operating.md` anew, from the registry that the program itself uses.

python docs/actions.py
"""

from __future__ import annotations

from pathlib import Path

from robotree.tui.line import manual

GUIDE = Path(__file__).parent / "operating.md"
BEGIN, END = "<!-- made by `python docs/actions.py` -->\n", "<!-- end -->\n"


def renewed(text: str) -> str:
    """Return the guide with the tables of today."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}{manual.tables()}{END}{after}"


if __name__ == "__main__":
    GUIDE.write_text(renewed(GUIDE.read_text(encoding="utf-8")), encoding="utf-8")
