"""Where the page of a line is: a file, an example that came with robotree, or a page of an installed package.

A package offers pages by the entry points `robotree.pages` (the entry points specification of the Python
packaging guide):

    [project.entry-points."robotree.pages"]
    patrol = "acme.patrol"                  a module: its file is the page
    guard = "acme.patrol:Guard"             one class of it
    night = "acme:night.bundle"             a bundle, or a script, beside the package

Nothing of a package is imported to list or find its pages: a host, and nobody else, runs them.

For `--watch`, the files of a page are looked at until one of them is saved.
"""

from __future__ import annotations

import asyncio
import importlib.util
import sys
from collections.abc import Iterator
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from robotree.tui.errors import ValueRefused
from robotree.tui.line import values

if TYPE_CHECKING:  # a list must not wait for it
    from importlib.metadata import EntryPoint

GROUP = "robotree.pages"
_FILES = (".bundle", ".yaml", ".clp", ".py")
"""Ends of an object's name that mean a file beside the package."""


class OfferedPage(NamedTuple):
    """A page that an installed package offers."""

    name: str
    package: str
    """Name and version of the distribution."""
    file: Path | None
    """None: the package says where it is, and it is not there."""
    wanted: str
    """Name of the class; empty: the only one in the file."""
    says: str
    """As the package says it."""


def offered() -> list[OfferedPage]:
    """Return the pages that the installed packages offer, by name."""
    from importlib.metadata import entry_points

    found = {(one.name, one.value): _read(one) for one in entry_points(group=GROUP)}
    return sorted(found.values(), key=lambda one: (one.name, one.package))


def _read(point: EntryPoint) -> OfferedPage:
    package = "" if point.dist is None else f"{point.dist.name} {point.dist.version}"
    module, _, what = (part.strip() for part in point.value.partition(":"))
    what = what.partition("[")[0].strip()
    place = next(_places(module), None)
    if what.endswith(_FILES):
        file, wanted = None if place is None else place.parent / what, ""
    else:
        file, wanted = place, what
    there = file if file is not None and file.is_file() else None
    return OfferedPage(point.name, package, there, wanted, point.value)


def _places(module: str) -> Iterator[Path]:
    """Yield the file of a module, which is not imported, and neither are the packages in which it lies."""
    top, *rest = module.split(".")
    try:
        spec = sys.modules[top].__spec__ if top in sys.modules else importlib.util.find_spec(top)
        for number, _ in enumerate(rest, 1):
            if spec is None or spec.submodule_search_locations is None:
                return
            name = ".".join((top, *rest[:number]))
            spec = PathFinder.find_spec(name, list(spec.submodule_search_locations))
    except (ImportError, ValueError, AttributeError):
        return
    if spec is not None and spec.origin is not None:
        yield Path(spec.origin)
    elif spec is not None:
        yield from (Path(folder) / "__init__.py" for folder in spec.submodule_search_locations or ())


def found(text: str) -> tuple[str, str]:
    """Return where the page of a line is.

    Args:
        text: FILE, FILE:CLASS, or the name of a page that a package offers.

    Returns:
        Path of its file, and the name of the class; empty: the only one in the file.

    Raises:
        ValueRefused: it is the name of no page, or of several.
    """
    path, wanted = values.source(text)
    if path.startswith("sha256:") or Path(path).exists() or Path(path).name != path or "." in path:
        return str(shipped(path)), wanted
    pages = offered()
    named = [one for one in pages if one.name == path]
    if not named:
        names = ", ".join(dict.fromkeys(one.name for one in pages))
        there = f"packages offer {names}" if names else "no installed package offers any"
        raise ValueRefused("FILE", f"there is no file {path!r} and no page of that name: {there}")
    if len(named) > 1:
        files = ", ".join(str(one.file or one.says) for one in named)
        raise ValueRefused("FILE", f"several packages offer {path!r}; take the file itself: {files}")
    (page,) = named
    if page.file is None:
        reason = f"{page.package or 'a package'} offers {path!r} at {page.says}, and nothing is there"
        raise ValueRefused("FILE", f"{reason}; install it anew")
    return str(page.file), wanted or page.wanted


def shipped(given: str) -> Path:
    """Return a source file; `examples/…` is in the wheel, too, where the current folder has none."""
    path = Path(given)
    if path.exists() or path.parts[:1] != ("examples",) or ".." in path.parts:
        return path
    from importlib.resources import files

    there = Path(str(files("robotree.examples").joinpath(*path.parts[1:])))
    return there if there.exists() else path


# -- the files of a page, looked at until one is saved ---------------------------------------------

PERIOD = 0.25
"""[s] between two looks at the files."""
SETTLE = 0.05
"""[s] for which they must stay as they are: an editor may write a file in several steps."""
LONGEST_SAVE = 1.0
"""[s] within which an editor puts a file back that it has moved away, or ends its writing."""

Look = dict[Path, tuple[int, int, int]]
"""Time of the last change [ns], inode and size of files and folders that are there."""


class PageFiles:
    """A page, the modules and data that belong to it, and the folders in which they lie.

    A save is seen however the editor writes: into the file, or by renaming another one. Only what changes the
    page counts as one: a file that is touched, or saved as it was, does not.
    """

    def __init__(self, path: str, wanted: str = "") -> None:
        """Take the path of the page and the name of its class (empty: the only one); read the files."""
        self.path, self.wanted = path, wanted
        self.mistaken = False
        """Whether the last version was refused: what mends it may lie where nothing has been until now, so
        the page is read at each look."""
        self._page = Path(path).expanduser()
        self._files: tuple[Path, ...] = ()
        self._seen: Look = {}
        self._version = ""
        self.read()

    def read(self) -> None:
        """Take the files as they are now as known."""
        from robotree.vr.base.errors import BundleError  # a list must not wait for them
        from robotree.vr.bundle import Bundle

        self._seen = self._look()  # what is saved while they are read is seen at the next look
        try:
            bundle = Bundle.read(self.path, self.wanted)
        except BundleError as error:
            self._version = str(error)
        else:
            self._files = tuple(self._page.parent / name for name in bundle.files)
            self._version = bundle.hash

    async def saved(self) -> None:
        """Wait until the page, or what belongs to it, is another one than the one that was read last."""
        known = self._version
        while self._version == known:
            await asyncio.sleep(PERIOD)
            if not self.mistaken and await asyncio.to_thread(self._look) == self._seen:
                continue
            await asyncio.to_thread(self.read)
            while self._version != known and await self._settled() != self._seen:
                await asyncio.to_thread(self.read)  # it was read while an editor wrote

    async def _settled(self) -> Look:
        """Wait until nobody writes, and the page is there with something in it; return how the files look."""
        look = await asyncio.to_thread(self._look)
        for _ in range(round(LONGEST_SAVE / SETTLE)):
            await asyncio.sleep(SETTLE)
            before, look = look, await asyncio.to_thread(self._look)
            if look == before and self._page in look and look[self._page][2]:
                break
        return look

    def _look(self) -> Look:
        files = {self._page, *self._files}
        found: Look = {}
        for path in files | {file.parent for file in files}:
            try:
                state = path.stat()
            except OSError:
                continue
            found[path] = (state.st_mtime_ns, state.st_ino, state.st_size)
        return found
