"""The content of a realm file: the processes, the robots and the bonds that there should be. Pure.

Every value is the word that was written, with its line: what is wrong with it is told at its place.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from robotree.tui.errors import BadRealmFile
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.grammar import Blank
from robotree.vr.base.group import RobotGroup, rule_of
from robotree.vr.base.written import Mark, Word

STANDS_BY = "standby-for"
"""Key of a host that has robots only when another one is away."""

SECTIONS: Mapping[str, str] = {
    "controllers": "sim",
    "lookups": "lookup",
    "directories": "directory",
    "hosts": "host",
    "proxies": "proxy",
    "views": "view",
    "spaces": "space serve",
}
"""Sections of processes, in the order of their start, and the verb that is each process."""

ONCE = frozenset({"reset-epoch", "take-over"})
"""Options of those verbs that a person gives once, for a reason: no file repeats them."""

KIND, CONTROLLER = "kind", "controller"
"""Keys of a process that are no options: the value behind the verb; the file's controller that it dials."""

KEYWORDS = frozenset({"realm", "none", "memory"})
"""The words that may stand for a file of keys, state or entries."""

NAMELESS = "sim"
"""The verb whose process is in no realm: its name stands in the file alone."""


def keys_of(verb: str) -> tuple[str, ...]:
    """Return what a file can say of a process: the options of its verb, and what stands behind the verb."""
    shape = BY_VERB[verb].shape
    kind = (KIND,) if Blank("KIND") in shape.parts else ()
    options = tuple(name for name in shape.options if name not in ONCE)
    return (*kind, *options, *((CONTROLLER,) if "connect" in options else ()))


class ProcessEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One process that there should be."""

    verb: str
    name: str
    mark: Mark = Mark()
    facets: dict[str, Word] = {}
    """By the keys of `keys_of`; a flag that is set is an empty word."""

    @property
    def id(self) -> str:
        """The name for steps and other entries."""
        return f"{self.verb} {self.name}"

    def text(self, key: str) -> str:
        """Return a facet; empty: it is not said."""
        return self.facets[key].text if key in self.facets else ""

    def words(self, folder: Path, address: str = "") -> tuple[str, ...]:
        """Return the line that is this process, behind `robotree`.

        Args:
            folder: from which paths in the file are meant.
            address: of its controller, or where it listens; empty: as the file says.
        """
        options = BY_VERB[self.verb].shape.options
        facets = {key: word.text for key, word in self.facets.items() if key in options}
        if address:
            facets["listen" if self.verb == NAMELESS else "connect"] = address
        found = self.verb.split()
        if KIND in self.facets:
            kind = self.text(KIND)
            found.append(placed(kind, folder) if ".py" in kind else kind)
        if self.verb != NAMELESS:
            found.append(self.name)
        for key, text in facets.items():
            value = placed(text, folder) if names_file(options[key], text) else text
            found += [f"--{key}", value] if options[key] else [f"--{key}"]
        return tuple(found)


class RobotEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One virtual robot that there should be."""

    name: str
    page: Word
    """Path from the file's folder, and `:Class` if there are several."""
    mark: Mark = Mark()
    hash: Word | None = None
    """Beginning of the hash of the page and what belongs to it (`Bundle.hash`); None: any page will do."""
    host: Word | None = None
    isolate: Word | None = None
    """Level of isolation; None: as its host has it."""
    settings: dict[str, Word] = {}
    role: Word | None = None
    slots: dict[str, tuple[Word, ...]] = {}
    """Children by slot or group; none: it shall be empty."""
    watches: dict[str, Word] = {}
    """Robots that are only watched, by slot."""

    @property
    def id(self) -> str:
        """The name for steps."""
        return f"robot {self.name}"


class GroupEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One group that there should be."""

    name: str
    mark: Mark = Mark()
    robots: tuple[Word, ...] = ()
    where: str = ""
    near: str = ""

    @property
    def id(self) -> str:
        """The name for steps."""
        return f"group {self.name}"

    @property
    def meant(self) -> RobotGroup:
        """The group as the realm keeps it."""
        names = tuple(dict.fromkeys(robot.text for robot in self.robots))
        return RobotGroup(name=self.name, names=names, rule=rule_of(self.where, self.near))


class RealmFile(msgspec.Struct, frozen=True, kw_only=True):
    """A whole realm."""

    path: str
    key: str = ""
    """Of all links that name none: a file, `realm` or `none`; empty: as the environment says."""
    processes: tuple[ProcessEntry, ...] = ()
    robots: tuple[RobotEntry, ...] = ()
    groups: tuple[GroupEntry, ...] = ()

    @property
    def folder(self) -> Path:
        """From which its paths are meant."""
        return Path(self.path).expanduser().absolute().parent

    def section(self, verb: str) -> dict[str, ProcessEntry]:
        """Return the processes of a verb, by name."""
        return {process.name: process for process in self.processes if process.verb == verb}

    def bonds(self) -> Iterator[tuple[RobotEntry, str, Word]]:
        """Yield parent, slot and child of each bond."""
        for robot in self.robots:
            for slot, children in robot.slots.items():
                for child in children:
                    yield robot, slot, child

    def error(self, mark: Mark, reason: str) -> BadRealmFile:
        """Return the error for a mistake at a place of the file."""
        return BadRealmFile(self.path, mark.line, reason)


def names_file(option: str, text: str) -> bool:
    """Whether the value of an option, by the name of its blank, is the path of a file."""
    return option in {"FILE", "STORE"} and text not in KEYWORDS and "://" not in text


def placed(path: str, folder: Path) -> str:
    """Return a path of a file from everywhere; `~` is the home."""
    return str(folder / Path(path).expanduser())
