"""Writes the running realm as a realm file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from robotree.tui.line import values
from robotree.tui.line.actions import BY_VERB
from robotree.tui.processes.programs import program_of
from robotree.tui.realm_file.content import (
    CONTROLLER,
    KEYWORDS,
    KIND,
    SECTIONS,
    GroupEntry,
    ProcessEntry,
    RealmFile,
    RobotEntry,
    keys_of,
    names_file,
)
from robotree.tui.realm_file.present import Present, Process, line_of
from robotree.tui.seen import wording
from robotree.vr.base import literal
from robotree.vr.base.errors import BundleError
from robotree.vr.base.written import Mark, Word
from robotree.vr.bundle import Bundle

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription

SHOWN = 16
"""Digits of the hash of a page that are written."""
_LOCAL = re.compile(r"^(?:tcp|udp):(?:127\.[0-9.]+|localhost|\[::1\]):([0-9]+)\b")
"""The port of an address on this machine."""
_RANGE = Path("/proc/sys/net/ipv4/ip_local_port_range")
NEUTRAL = "neutral"
"""The role of a robot that plays none (`vr.scripts.roles`)."""


def saved(there: Present, path: Path) -> tuple[RealmFile, list[str]]:
    """Return what runs as a realm file.

    Args:
        there: what runs.
        path: where the file will lie: paths in it are written from its folder.

    Returns:
        The file; what it cannot say, as sentences.
    """
    return _Saving(there, path.absolute().parent).saved(str(path))


class _Saving:
    def __init__(self, there: Present, folder: Path) -> None:
        self._there, self._folder = there, folder
        self._notes: list[str] = []

    def saved(self, path: str) -> tuple[RealmFile, list[str]]:
        there = self._there
        linked = {
            process.program.key for process in there.processes.values() if "key" in keys_of(process.line.verb)
        }
        key = self._key(linked.pop()) if len(linked) == 1 else ""
        processes = [
            *self._controllers(),
            *(self._process(process, common=bool(key)) for process in there.processes.values()),
        ]
        processes += self._away({one.name: one for one in processes if one.verb == "host"})
        order = list(SECTIONS.values())
        processes.sort(key=lambda one: (order.index(one.verb), one.name))
        robots = [one for _, robot in sorted(there.virtual().items()) for one in self._robot(robot)]
        for what, where in sorted(there.others.items()):
            if not (what.startswith("robot ") and what.removeprefix("robot ") in there.virtual()):
                self._notes.append(
                    f"{what} in {where} is not in the file: no line of robotree has started it"
                )
        self._notes += [
            f"{name} in {where} is not in the file: it does not answer"
            for name, where in sorted(there.silent.items())
        ]
        groups = [
            GroupEntry(name=name, robots=tuple(map(_word, group.names)), where=group.rule)
            for name, group in sorted(there.groups.items())
        ]
        file = RealmFile(
            path=path, key=key, processes=tuple(processes), robots=tuple(robots), groups=tuple(groups)
        )
        return file, self._notes

    def _key(self, given: str) -> str:
        """Return what a variable says of keys as a file says it: the realm's own key is called `realm`."""
        if not given or given in KEYWORDS:
            return given
        return "realm" if given.endswith(f"/{self._there.realm}/realm.key") else self._near(Path(given))

    def _near(self, path: Path) -> str:
        """Return a path from the folder of the file, if it lies in it."""
        return str(path.relative_to(self._folder)) if path.is_relative_to(self._folder) else str(path)

    # -- processes ---------------------------------------------------------------------------------

    def _controllers(self) -> Iterator[ProcessEntry]:
        for name, controller in self._there.controllers.items():
            program = program_of(controller.pid)
            line = None if program is None else line_of(program)
            if program is not None and line is not None:
                entry = self._process(Process(line, program), common=True)
                yield msgspec.structs.replace(entry, name=name)

    def _process(self, process: Process, *, common: bool) -> ProcessEntry:
        """Return a process; `common`: what its environment says of keys is said for all of them."""
        line, verb = process.line, process.line.verb
        options = BY_VERB[verb].shape.options
        facets: dict[str, Word] = {}
        for key in keys_of(verb):
            text = line.text("KIND" if key == KIND else f"--{key}")
            if key == KIND and ".py" in text:
                file, wanted = values.source(text)
                text = self._near(process.path(file)) + (f":{wanted}" if wanted else "")
            elif text and names_file(options.get(key, ""), text):
                text = self._near(process.path(text))
            if text or line.flag(f"--{key}"):
                facets[key] = _word(text)
        if "key" in keys_of(verb) and not {"key", "open"} & {*facets} and not common and process.program.key:
            facets["key"] = _word(self._key(process.program.key))
        for name, controller in self._there.controllers.items():
            if "connect" in facets and facets["connect"].text == controller.address:
                del facets["connect"]
                facets[CONTROLLER] = _word(name)
        if "connect" in facets:
            self._note_chance(line.text("NAME"), facets["connect"].text)
        return ProcessEntry(verb=verb, name=line.text("NAME"), facets=facets)

    def _note_chance(self, name: str, address: str) -> None:
        """Note a port that this machine gives out by chance: nobody listens there again."""
        found = _LOCAL.search(address)
        first, last = _given_by_chance()
        if found and first <= int(found[1]) <= last:
            self._notes.append(
                f"{name} connects to {address}, a port that was free by chance: after a restart its "
                f"controller has another one; give it a port below {first}, or write it into `controllers`"
            )

    def _away(self, hosts: Mapping[str, ProcessEntry]) -> Iterator[ProcessEntry]:
        """Return the hosts whose robots others have taken over, as they are when they come back."""
        for host, before in self._there.instead.items():
            if before not in hosts:
                self._notes.append(f"{before} does not run; it is in the file, for {host} has its robots")
                facets = hosts[host].facets if host in hosts else {}
                kept = {key: word for key, word in facets.items() if key == "journal"}
                yield ProcessEntry(verb="host", name=before, facets=kept)

    # -- robots ------------------------------------------------------------------------------------

    def _robot(self, robot: RobotDescription) -> Iterator[RobotEntry]:
        if not robot.page:
            self._notes.append(f"{robot.name} is not in the file: nobody knows where its page lies")
            return
        digest = self._there.pages.get(robot.name, "")
        self._compare(robot, digest)
        path, wanted = values.source(robot.page)
        role = robot.attributes.get("role", NEUTRAL) if robot.command("play") else NEUTRAL
        slots: dict[str, tuple[Word, ...]] = {}
        for slot in robot.slots:
            if slot.child is not None:
                place = slot.group or slot.name
                slots[place] = (*slots.get(place, ()), _word(slot.child.name))
        yield RobotEntry(
            name=robot.name,
            page=_word(self._near(Path(path)) + (f":{wanted}" if wanted else "")),
            hash=_word(digest[:SHOWN]) if digest else None,
            host=_word(self._there.home_of(robot)),
            isolate=None if robot.isolation == "none" else _word(robot.isolation),
            settings={
                setting.name: _word(_written(setting.default))
                for setting in wording.settings(robot)
                if setting.default is not None
            },
            role=None if role == NEUTRAL else _word(role),
            slots=slots,
            watches={slot.name: _word(slot.watched.name) for slot in robot.slots if slot.watched is not None},
        )

    def _compare(self, robot: RobotDescription, digest: str) -> None:
        """Note if the page on the disk is not the one that runs: the file names what runs."""
        path, wanted = values.source(robot.page)
        try:
            now = Bundle.read(path, wanted).hash
        except BundleError as error:
            self._notes.append(f"{robot.name}: {error}; `apply` will refuse the file")
            return
        if now != digest:
            self._notes.append(
                f"{path} has changed since {robot.name} was made of it; `apply` will refuse the file until "
                f"`robotree reload {robot.name}` and another `save`, or until its hash is taken out"
            )


def _given_by_chance() -> tuple[int, int]:
    """Return the first and the last port that Linux gives to who asks for any (ip(7))."""
    try:
        first, last = map(int, _RANGE.read_text().split())
    except (OSError, ValueError):
        return 32768, 60999
    return first, last


def _written(value: Any) -> str:
    """Return a setting as it is typed."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    return repr(value) if isinstance(value, float | int) else literal.write(value)


def _word(text: str) -> Word:
    return Word(text, Mark())
