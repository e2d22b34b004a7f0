"""Modules and data beside a page, for one robot: a private package, so that no two robots mix them up.

The page is the package itself: `from . import helper` and `from .lib.grip import close` are Python's own. An
absolute import (`import helper`) is led to the package by an `__import__` that only the modules of this
package have. Nobody's import path is touched. Their files lie in a folder of their own as long as the robot
lives, so that `Path(__file__).with_name("map.json")` finds them.
"""

from __future__ import annotations

import atexit
import builtins
import hashlib
import importlib.abc
import importlib.machinery
import importlib.util
import linecache
import shutil
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any

from robotree.files import overwrite
from robotree.vr.base.errors import PRIVATE_FOLDER, PRIVATE_MODULE, BrokenSource
from robotree.vr.running.page_trace import file_in_tracebacks

PREFIX = PRIVATE_MODULE
"""Names of private modules begin with it."""

_packages: dict[str, Package] = {}
"""By the name of the page's module."""


class Package:
    """The files of one robot's page."""

    def __init__(self, module: ModuleType, path: str, files: Mapping[str, bytes]) -> None:
        """Lay the files into a folder, and make the page's module a package.

        Args:
            module: of the page, not yet run.
            path: of the page, as its author knows it.
            files: beside it, by their path from its folder.

        Raises:
            BrokenSource: a file's path leads elsewhere.
        """
        self.name, self.path, self.files = module.__name__, path, files
        self.folder = Path(tempfile.mkdtemp(prefix=PRIVATE_FOLDER))
        self.sources: dict[str, str] = {}
        """Name in tracebacks of each module that was loaded, and its path from the page's folder."""
        _packages[self.name] = self
        for file, data in files.items():
            self._lay(file, data)
        self._tops = {
            PurePosixPath(file).parts[0].removesuffix(".py") for file in files if file.endswith(".py")
        }
        self._stem = Path(path).stem
        module.__file__ = str(self.folder / Path(path).name)
        module.__path__ = [str(self.folder)]
        module.__package__ = self.name
        vars(module)["__builtins__"] = self._builtins = {**vars(builtins), "__import__": self._import}

    def _lay(self, file: str, data: bytes) -> None:
        place = PurePosixPath(file)
        if place.is_absolute() or ".." in place.parts or not place.parts:
            raise BrokenSource(path=self.path, reason=f"the file {file!r} does not lie beside it")
        target = self.folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        overwrite(target, data)

    def close(self) -> None:
        """Forget the modules and remove the files."""
        _packages.pop(self.name, None)
        for name in [name for name in sys.modules if name.startswith(f"{self.name}.")]:
            sys.modules.pop(name, None)
        for source in self.sources:
            linecache.cache.pop(source, None)
        shutil.rmtree(self.folder, ignore_errors=True)

    def find(self, fullname: str) -> importlib.machinery.ModuleSpec | None:
        """Return how a module of the package is loaded; None: there is none of this name."""
        place = PurePosixPath(*fullname.split(".")[1:])
        file = next((one for one in (f"{place}/__init__.py", f"{place}.py") if one in self.files), "")
        is_package = file != f"{place}.py"
        if not file and not any(one.startswith(f"{place}/") and one.endswith(".py") for one in self.files):
            return None
        loader, origin = (_Loader(self, file), str(self.folder / file)) if file else (None, None)
        spec = importlib.machinery.ModuleSpec(fullname, loader, origin=origin, is_package=is_package)
        if is_package:
            spec.submodule_search_locations = [str(self.folder / place)]
        return spec

    def run(self, module: ModuleType, file: str) -> None:
        """Run one of the modules."""
        data = self.files[file]
        digest = hashlib.sha256(data).hexdigest()
        source = file_in_tracebacks(str(Path(self.path).parent / file), digest)
        text = importlib.util.decode_source(data)
        self.sources[source] = file
        linecache.cache[source] = (len(text), None, text.splitlines(keepends=True), source)
        module.__file__ = str(self.folder / file)
        vars(module)["__builtins__"] = self._builtins
        exec(compile(data, source, "exec", dont_inherit=True), vars(module))  # noqa: S102 # as for the page

    def _import(
        self,
        name: str,
        globals: Mapping[str, Any] | None = None,  # noqa: A002 # Python's own names
        locals: Mapping[str, Any] | None = None,  # noqa: A002 # as above
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        """Do what an import statement of a module of this package means."""
        top, _, rest = name.partition(".")
        if level or top not in {*self._tops, self._stem}:
            return builtins.__import__(name, globals, locals, fromlist or (), level)
        if top == self._stem and top not in self._tops:
            return sys.modules[self.name]
        found = builtins.__import__(f"{self.name}.{name}", globals, locals, fromlist or ("__name__",), 0)
        return found if fromlist or not rest else sys.modules[f"{self.name}.{top}"]


class _Loader(importlib.abc.Loader):
    def __init__(self, package: Package, file: str) -> None:
        self._package, self._file = package, file

    def exec_module(self, module: ModuleType) -> None:
        """Run the module."""
        self._package.run(module, self._file)


class _Finder(importlib.abc.MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find a module of a private package."""
        del path, target
        if not fullname.startswith(PREFIX):
            return None
        package = _packages.get(fullname.partition(".")[0])
        return None if package is None else package.find(fullname)


sys.meta_path.insert(0, _Finder())


@atexit.register
def close_all() -> None:
    """Remove the files of all packages: the process ends."""
    for package in list(_packages.values()):
        package.close()


def package_of(name: str) -> Package | None:
    """Return the package of a page's module, if it has files beside it."""
    return _packages.get(name)
