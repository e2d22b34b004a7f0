"""A realm file, read: what is wrong in it is one sentence with its line, before anything is started. Pure.

key: realm                                  # of all links that name none
controllers:                                # simulated ones; a real one needs no entry
  table: {kind: arm, listen: "tcp:127.0.0.1:5760"}
lookups: [lookup-1]
hosts: [host-1]
proxies:
  arm-1: {kind: arm, controller: table}     # or connect: URL
views:
  cell: {controller: table}
robots:
  mover:
    page: move_to.py                        # from the folder of this file
    isolate: process                        # none, process or sandbox; left out: as its host has it
    host: host-1                            # left out: the first that takes it
    settings: {speed: 20 cm/s}
    slots: {arm: arm-1}                     # several children of a group: [rover-1, rover-2]
    watches: {seen: arm-2}                  # without a lease: others may command it
groups:
  carriers: [rover-1, rover-2]
  strong: {where: kind = Rover & battery > 30, near: hall}   # and robots: [rover-1]
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping

from robotree.tui.errors import BadLine, BadRealmFile, ValueRefused
from robotree.tui.line import manual
from robotree.tui.line.actions import BY_VERB
from robotree.tui.realm_file.content import (
    CONTROLLER,
    KIND,
    NAMELESS,
    SECTIONS,
    GroupEntry,
    ProcessEntry,
    RealmFile,
    RobotEntry,
    keys_of,
)
from robotree.vr.base import literal
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import BadName, BrokenScript, VrError
from robotree.vr.base.group import checked
from robotree.vr.base.permissions import LEVELS
from robotree.vr.base.written import (
    Entries,
    Items,
    Mark,
    Word,
    Written,
    entries,
    items,
    read,
    suggestion,
    value_of,
    word,
)
from robotree.vr.scripts.requirement import requirement

ROBOT_KEYS = ("page", "hash", "host", "isolate", "settings", "role", "slots", "watches")
NOUNS = {NAMELESS: "controller", "space serve": "space"}
"""The name of a process whose verb is no noun."""
GROUP_KEYS = ("robots", "where", "near")
KEYS = ("key", *SECTIONS, "robots", "groups")
HASH = re.compile(r"[0-9a-f]{8,64}")

Kinds = Mapping[str, Collection[str]]
"""The kinds that a verb knows, by the verb; a verb that is not in it takes any."""


def read_file(text: str, path: str, kinds: Kinds | None = None) -> RealmFile:
    """Read a realm file.

    Args:
        text: YAML.
        path: where it is kept; paths in it are meant from its folder.
        kinds: of controllers and proxies that there are.

    Raises:
        BadRealmFile: something in it cannot be meant.
    """
    try:
        found = _read(read(text, path), path)
        _check(found, kinds or {})
    except BrokenScript as error:
        raise BadRealmFile(path, int(error.data["line"]), str(error.data["reason"])) from None
    return found


def _read(root: Written, path: str) -> RealmFile:
    if not isinstance(root, Entries):
        raise root.mark.error(f"a realm is written as `section: …`, with sections of {', '.join(KEYS)}")
    root.expect(KEYS, "a realm")
    processes = [process for section, verb in SECTIONS.items() for process in _processes(root, section, verb)]
    robots = [_robot(name, facets) for name, facets in entries(root.get("robots"), "robots", root.mark)]
    groups = [_group(name, given) for name, given in entries(root.get("groups"), "groups", root.mark)]
    key = root.get("key")
    return RealmFile(
        path=path,
        key="" if key is None else word(key, "key", root.mark).text,
        processes=tuple(processes),
        robots=tuple(robots),
        groups=tuple(groups),
    )


# -- processes -------------------------------------------------------------------------------------


def _processes(root: Entries, section: str, verb: str) -> Iterator[ProcessEntry]:
    """Read a section: names with what is to be said of each, or a list of names alone."""
    given = root.get(section)
    if not isinstance(given, Items | Word) or (isinstance(given, Word) and given.empty):
        for name, facets in entries(given, section, root.mark):
            yield _process(verb, name, facets)
        return
    known: set[str] = set()
    for one in items(given, root.mark).items:
        name = word(one, "a name", one.mark)
        if name.text in known:
            raise name.mark.error(f"{name.text!r} stands here twice")
        known.add(name.text)
        yield _process(verb, name, None)


def _process(verb: str, name: Word, given: Written | None) -> ProcessEntry:
    _expect_name(name)
    options = BY_VERB[verb].shape.options
    listed = entries(given, f"{verb} {name.text}", name.mark)
    listed.expect(keys_of(verb), f"a {NOUNS.get(verb, verb)}")
    facets: dict[str, Word] = {}
    for key, thing in listed:
        if key.text in options and not options[key.text]:
            flag = value_of(word(thing, key.text, key.mark))
            if not isinstance(flag, bool):
                raise thing.mark.error(f"{key.text} must be yes or no")
            if flag:
                facets[key.text] = Word("", thing.mark)
        elif isinstance(thing, Entries):  # cameras: {left: 101, right: 102}
            pairs = (f"{part.text}={word(one, part.text, part.mark).text}" for part, one in thing)
            facets[key.text] = Word(",".join(pairs), thing.mark)
        else:
            facets[key.text] = word(thing, key.text, key.mark)
    return ProcessEntry(verb=verb, name=name.text, mark=name.mark, facets=facets)


# -- robots ----------------------------------------------------------------------------------------


def _robot(name: Word, given: Written) -> RobotEntry:
    _expect_name(name)
    facets = entries(given, f"robot {name.text}", name.mark)
    facets.expect(ROBOT_KEYS, "a robot")

    def optional(key: str) -> Word | None:
        thing = facets.get(key)
        return None if thing is None else word(thing, key, name.mark)

    digest = optional("hash")
    if digest is not None and not HASH.fullmatch(digest.text):
        raise digest.mark.error(f"{digest.text!r} is no hash: write 8 to 64 of the digits 0-9 and a-f")
    isolate = optional("isolate")
    if isolate is not None and isolate.text not in LEVELS:
        raise isolate.mark.error(f"{isolate.text!r} is no level of isolation: write {', '.join(LEVELS)}")
    settings = entries(facets.get("settings"), "settings", name.mark)
    slots = entries(facets.get("slots"), "slots", name.mark)
    watches = entries(facets.get("watches"), "watches", name.mark)
    return RobotEntry(
        name=name.text,
        mark=name.mark,
        page=word(facets.get("page"), f"the page of {name.text}", name.mark),
        hash=digest,
        host=optional("host"),
        isolate=isolate,
        settings={key.text: _setting(thing) for key, thing in settings},
        role=optional("role"),
        slots={slot.text: _children(slot, thing) for slot, thing in slots},
        watches={slot.text: word(thing, f"a robot in {slot.text}", slot.mark) for slot, thing in watches},
    )


def _group(name: Word, given: Written) -> GroupEntry:
    """Read a group: a list of names, or what its members are."""
    if isinstance(given, Items | Word):
        found = GroupEntry(name=name.text, mark=name.mark, robots=_children(name, given))
    else:
        facets = entries(given, f"group {name.text}", name.mark)
        facets.expect(GROUP_KEYS, "a group")
        robots, where, near = (facets.get(key) for key in GROUP_KEYS)
        found = GroupEntry(
            name=name.text,
            mark=name.mark,
            robots=() if robots is None else _children(name, robots),
            where="" if where is None else word(where, "where", name.mark).text,
            near="" if near is None else word(near, "near", name.mark).text,
        )
    try:
        checked(found.meant)
        requirement(found.meant.rule)
    except VrError as error:
        raise name.mark.error(str(error)) from None
    return found


def _setting(thing: Written) -> Word:
    """Return a setting as it is typed on the command line."""
    return thing if isinstance(thing, Word) else Word(literal.write(_plain(thing)), thing.mark)


def _plain(thing: Written) -> object:
    match thing:
        case Word(text=text):
            return text
        case Items(items=parts):
            return [_plain(part) for part in parts]
        case Entries():
            return {key.text: _plain(one) for key, one in thing}


def _children(slot: Word, thing: Written) -> tuple[Word, ...]:
    return tuple(word(one, f"a child in {slot.text}", slot.mark) for one in items(thing, slot.mark).items)


def _expect_name(name: Word) -> None:
    try:
        check_name(name.text)
    except BadName as error:
        raise name.mark.error(str(error)) from None


# -- all together ----------------------------------------------------------------------------------


def _check(found: RealmFile, kinds: Kinds) -> None:
    for process in found.processes:
        _check_process(process, found, kinds.get(process.verb, ()))
    proxies, hosts = found.section("proxy"), found.section("host")
    for group in found.groups:
        if group.name in names_in(found):
            raise group.mark.error(f"{group.name!r} is also a robot: a group needs a name of its own")
    for robot in found.robots:
        if robot.name in proxies:
            line = proxies[robot.name].mark.line
            raise robot.mark.error(f"{robot.name!r} is also a proxy in line {line}: two robots have one name")
        if robot.host is not None and hosts and robot.host.text not in hosts:
            hint = suggestion(robot.host.text, hosts)
            raise robot.host.mark.error(f"no host is called {robot.host.text!r}{hint}")
    _check_bonds(found)


def _check_process(process: ProcessEntry, found: RealmFile, kinds: Collection[str]) -> None:
    needed = next((key for key in ("listen", "connect") if key in keys_of(process.verb)), "")
    controller = process.facets.get(CONTROLLER)
    if controller is not None:
        there = found.section(NAMELESS)
        if controller.text not in there:
            hint = suggestion(controller.text, there)
            raise controller.mark.error(f"no controller is called {controller.text!r}{hint}")
        if needed in process.facets:
            raise process.facets[needed].mark.error(
                f"say {CONTROLLER} or {needed} of {process.name}, not both"
            )
    elif needed and needed not in process.facets:
        other = f" or {CONTROLLER}" if CONTROLLER in keys_of(process.verb) else ""
        raise process.mark.error(f"{process.name} lacks {needed}{other}")
    if KIND in keys_of(process.verb):
        kind = process.facets.get(KIND)
        if kind is None:
            raise process.mark.error(f"{process.name} lacks {KIND}")
        if kinds and kind.text not in kinds and ".py" not in kind.text:
            hint = suggestion(kind.text, kinds)
            raise kind.mark.error(f"there is no kind {kind.text!r}{hint}; there is: {', '.join(kinds)}")
    try:
        manual.shell().parse(process.words(found.folder, "tcp:127.0.0.1:0" if controller else ""))
    except (BadLine, ValueRefused, BadName) as error:
        raise process.mark.error(error.reason if isinstance(error, BadLine) else str(error)) from None


def _check_bonds(found: RealmFile) -> None:
    """Refuse two parents of one child, and robots that would command each other in a circle."""
    parents: dict[str, tuple[str, Mark]] = {}
    for robot, slot, child in found.bonds():
        place = f"{robot.name}.{slot}"
        if child.text in parents:
            other, mark = parents[child.text]
            raise child.mark.error(
                f"{child.text} stands in {place} and in {other} (line {mark.line}): one commands it"
            )
        parents[child.text] = place, child.mark
        above, way = robot.name, [child.text, robot.name]
        while above != child.text and above in parents:
            above = parents[above][0].partition(".")[0]
            way.append(above)
        if above == child.text:
            raise child.mark.error(f"these robots would command each other in a circle: {' ← '.join(way)}")


def names_in(found: RealmFile) -> set[str]:
    """Return the names of all robots of a file."""
    return {*found.section("proxy"), *(robot.name for robot in found.robots)}
