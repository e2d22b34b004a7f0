"""The size of each room: code lines, functions, and lines that only describe.

    python bench/house.py [FOLDER...]

Without a folder it prints one line for each room. A line of code is one on which something stands that is no
comment and no part of a docstring, or of the text below a name that describes it. Sources that are generated
are not counted: `protocol/messages` and `kinds`.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
ROOMS = (
    *("front", "files", "protocol", "vr", "proxy", "client"),
    *("sim", "testing", "tui", "examples", "bench", "tests"),
)
GENERATED = (ROOT / "protocol" / "messages", ROOT / "kinds")
LAYOUT = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER
}  # fmt: skip


class Size(NamedTuple):
    """Counts of one file, or of many."""

    files: int = 0
    code: int = 0
    described: int = 0
    functions: int = 0
    longest: int = 0
    """[lines of code] of the longest function."""

    def plus(self, more: Size) -> Size:
        """Return both together."""
        sums = (mine + its for mine, its in zip(self[:-1], more[:-1], strict=True))
        return Size(*sums, max(self.longest, more.longest))


def size_of(source: str) -> Size:
    """Count what is in one file."""
    nodes = list(ast.walk(ast.parse(source)))
    texts = {
        line
        for node in nodes
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    code = {
        line
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type not in LAYOUT
        for line in range(token.start[0], token.end[0] + 1)
    } - texts
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    bodies = (code.intersection(range(node.lineno, (node.end_lineno or 0) + 1)) for node in functions)
    return Size(1, len(code), len(texts), len(functions), max(map(len, bodies), default=0))


def size_of_folder(folder: str) -> Size:
    """Count what is in all files of a folder."""
    total = Size()
    for path in sorted((ROOT / folder).rglob("*.py")):
        if "node_modules" not in path.parts and not any(map(path.is_relative_to, GENERATED)):
            total = total.plus(size_of(path.read_text()))
    return total


def main() -> None:
    """Print one line for each room, or for each folder that is named."""
    print("| folder | files | code lines | lines of docstrings | functions | longest function |")
    print("|---|--:|--:|--:|--:|--:|")
    total = Size()
    for folder in sys.argv[1:] or ROOMS:
        size = size_of_folder(folder)
        total = total.plus(size)
        print(f"| {folder} | {' | '.join(map(str, size))} |")
    print(f"| all | {' | '.join(map(str, total))} |")


if __name__ == "__main__":
    main()
