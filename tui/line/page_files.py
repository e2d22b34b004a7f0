"""The files of a page, looked at until one of them is saved: for `--watch`."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotree.vr.base.errors import BundleError
from robotree.vr.bundle import Bundle

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
