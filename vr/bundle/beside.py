"""Files beside a page that belong to it: modules that it imports, and data that it names.

A page is read with them, so that they reach every host and are never older than the page. A module belongs to
it if it is imported by name from the folder of the page or below it, by the page or by such a module. Data
belong to it if a module that uses `__file__` names them in a text: a file, a folder, or a pattern such as
`maps/*.json`. What is put together at run time, and `importlib.import_module`, cannot be seen.
"""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from robotree.files import read
from robotree.vr.base.errors import BrokenSource
from robotree.vr.bundle.manifest import PANEL, PROGRAM
from robotree.vr.bundle.syntax import parse

LARGEST = 4_000_000
"""[bytes] of all files beside a page."""
MOST = 200
"""Files beside a page."""
_OURS = "robotree"
_LONGEST_NAME = 200


def beside(path: Path, source: str) -> dict[str, bytes]:
    """Return the files that belong to the page of a source, by their path from its folder.

    Raises:
        BrokenSource: they are too large or too many, one cannot be read, or an import leads above the folder.
    """
    collector = _Collector(path)
    collector.look(source, PurePosixPath(path.name))
    collector.take_panel()
    return collector.found


class _Collector:
    def __init__(self, path: Path) -> None:
        self.path, self.folder = path, path.absolute().parent
        self.found: dict[str, bytes] = {}

    def take_panel(self) -> None:
        """Take the panels of the page, if it has any, and what a program among them imports."""
        for end in (PANEL, PROGRAM):
            panel = PurePosixPath(f"{self.path.stem}{end}")
            if self.folder.joinpath(panel).is_file():
                data = self._take(panel)
                if end == PROGRAM:
                    self.look(data.decode("utf-8-sig", "replace"), panel)

    def look(self, source: str, module: PurePosixPath) -> None:
        """Take what one module imports and names; a mistake in its syntax is told when it is loaded."""
        try:
            tree = parse(source)
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            return
        uses_file = False
        texts: list[str] = []
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                for name in self._names(node, module):
                    self._take_module(name)
            elif isinstance(node, ast.Name) and node.id == "__file__":
                uses_file = True
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
        for text in texts if uses_file else ():
            self._take_data(text, module.parent)

    def _names(self, node: ast.Import | ast.ImportFrom, module: PurePosixPath) -> Iterator[PurePosixPath]:
        """Yield where the modules of an import would lie."""
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield PurePosixPath(*alias.name.split("."))
            return
        base = PurePosixPath()
        if node.level:
            parents = [module.parent, *module.parent.parents]
            if node.level > len(parents):
                reason = f"line {node.lineno}: an import leads above the folder of the page"
                raise BrokenSource(path=str(self.path), reason=f"{reason}; put the module beside it")
            base = parents[node.level - 1]
        if node.module:
            base = base.joinpath(*node.module.split("."))
            yield base
        for alias in node.names:
            yield base / alias.name

    def _take_module(self, name: PurePosixPath) -> None:
        """Take a module, and the packages in which it lies, if they are there."""
        if not name.parts or name.parts[0] == _OURS:
            return
        packages = [parent / "__init__.py" for parent in [*reversed(name.parents)][1:]]
        for file in (*packages, name.with_name(f"{name.name}.py"), name / "__init__.py"):
            known = str(file) in {*self.found, self.path.name}
            if not known and self.folder.joinpath(file).is_file():
                self.look(self._take(file).decode("utf-8-sig", "replace"), file)

    def _take_data(self, text: str, folder: PurePosixPath) -> None:
        """Take the files that a text names, if there are any."""
        if not 0 < len(text) <= _LONGEST_NAME or not text.isprintable() or PurePosixPath(text).is_absolute():
            return
        base = self.folder / folder
        paths = base.glob(text) if "*" in text else [base / text]
        for path in sorted(paths):
            inside = Path(os.path.normpath(path))
            if inside == self.folder or not inside.is_relative_to(self.folder):
                continue
            for file in sorted(inside.rglob("*")) if inside.is_dir() else [inside]:
                place = PurePosixPath(file.relative_to(self.folder).as_posix())
                hidden = any(part.startswith((".", "__pycache__")) for part in place.parts)
                if file.is_file() and not hidden and file != self.path.absolute():
                    self._take(place)

    def _take(self, file: PurePosixPath) -> bytes:
        try:
            data = read(self.folder / file, LARGEST)
        except OSError as error:
            reason = f"{file}, which belongs to it, cannot be read: {error.strerror or error}"
            raise BrokenSource(path=str(self.path), reason=reason) from None
        self.found[str(file)] = data
        if len(self.found) > MOST or sum(map(len, self.found.values())) > LARGEST:
            sentence = (
                f"more than {MOST} files or {LARGEST // 1_000_000} MB belong to it ({file} is the last)"
            )
            reason = f"{sentence}; keep large data elsewhere, and name its absolute path"
            raise BrokenSource(path=str(self.path), reason=reason)
        return data
