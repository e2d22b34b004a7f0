"""The figures of the house: the size of each room, words of the guides, imports.

    python bench/house.py [sizes] [words] [imports] [FOLDER...]

Without a word it prints all of them, in half a minute; with folders, their sizes instead of those of the
rooms. A line of code is one on which something stands that is no comment and no part of a docstring, or of
the text below a name that describes it. Sources that are generated count, too. Words are those of `docs` and
`docs/guide` outside of fenced blocks, which are programs: what has a letter or a digit is a word.
`docs/decisions` and `docs/reference`, which a program writes, do not count. Installation, calls, stories are
measured by `bench/install.py`, `bench/calls.py` and `bench/world.py`.
"""

from __future__ import annotations

import argparse
import ast
import io
import sys
import tokenize
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1]))

from measuring import imports

from tests.guide.words import words_of_guides
from tests.wheel import ROOT

ROOMS = (
    *("front", "files", "kinds", "protocol", "vr", "proxy", "client"),
    *("sim", "testing", "tui", "examples", "bench", "tests"),
)
BEFORE = {"vr": 16_700, "protocol": 9_100, "tui": 11_300, "sim": 6_000, "proxy": 2_000, "tests": 44_600}
"""Lines of code when the work on the house began. Wanted for `vr`: 16,000."""
IMPORTS = {
    "import robotree.protocol": 60,
    "from robotree.vr import VirtualRobot": 80,
    "from robotree import connect": 60,
    "from robotree.testing import rehearse": 150,
}
"""What is imported, and the processor time [ms] that was promised beside Python's own start."""
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
        if "node_modules" not in path.parts:
            total = total.plus(size_of(path.read_text()))
    return total


def tell_sizes(chosen: Sequence[str]) -> None:
    """Print one line for each room, or for each folder that is named."""
    print("| folder | files | code lines | lines of docstrings | functions | longest | code before |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    total = Size()
    for folder in chosen or ROOMS:
        size = size_of_folder(folder)
        total = total.plus(size)
        print(f"| {folder} | {' | '.join(map(str, size))} | {BEFORE.get(folder, '')} |")
    print(f"| all | {' | '.join(map(str, total))} | |")


def tell_words() -> None:
    """Print how many words the guides have."""
    print(f"{words_of_guides()} words in the guides, promised 35000")


def tell_imports() -> None:
    """Print the processor time of imports in new processes."""
    for code, promised in IMPORTS.items():
        print(f"{code}: {1e3 * imports(code, 15):.0f} ms of processor time, promised {promised}")


PARTS: dict[str, Callable[[], None]] = {"words": tell_words, "imports": tell_imports}


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("words", nargs="*", metavar="PART", help=f"sizes, {', '.join(PARTS)}, or a folder")
    words = parser.parse_args().words
    folders = [word for word in words if word not in PARTS and word != "sizes"]
    if not words or "sizes" in words or folders:
        tell_sizes(folders)
    for part, tell in PARTS.items():
        if not words or part in words:
            print(f"\n{part}", flush=True)
            tell()


if __name__ == "__main__":
    main()
