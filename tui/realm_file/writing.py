"""A realm file, written: so that it is read as it was meant, and that a person can go on editing it. Pure."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator

from robotree.tui.line.actions import BY_VERB
from robotree.tui.realm_file.content import SECTIONS, GroupEntry, ProcessEntry, RealmFile, RobotEntry
from robotree.vr.base.written import Word

_BARE = re.compile(r"[A-Za-z0-9./_][A-Za-z0-9./_+ -]*(?<! )|[A-Za-z0-9_./-]+\.py:[A-Za-z_]\w*")
"""A text that YAML reads unchanged without quotes, also between braces."""


def write_file(found: RealmFile, *, comments: Iterable[str] = ()) -> str:
    """Return the text of a realm file.

    Args:
        found: what it says.
        comments: lines at its top.
    """
    lines = [f"# {comment}" for comment in comments]
    lines += [f"key: {_text(found.key)}"] if found.key else []
    for section, verb in SECTIONS.items():
        lines += _section(section, list(found.section(verb).values()))
    if found.robots:
        lines += ["", "robots:"]
        for robot in found.robots:
            lines += _robot(robot)
    if found.groups:
        lines += ["", "groups:", *map(_group, found.groups)]
    return "\n".join([*lines, ""])


def _section(section: str, processes: list[ProcessEntry]) -> Iterator[str]:
    if not processes:
        return
    if not any(process.facets for process in processes):
        yield f"{section}: [{', '.join(_text(process.name) for process in processes)}]"
        return
    yield f"{section}:"
    for process in processes:
        options = BY_VERB[process.verb].shape.options
        facets = (
            f"{key}: {_text(word.text) if options.get(key, 'KIND') else 'yes'}"
            for key, word in process.facets.items()
        )
        yield f"  {_text(process.name)}: {{{', '.join(facets)}}}"


def _group(group: GroupEntry) -> str:
    names = f"[{', '.join(map(_word, group.robots))}]"
    if not (group.where or group.near):
        return f"  {_text(group.name)}: {names}"
    facets = [f"robots: {names}"] if group.robots else []
    facets += [f"where: {_text(group.where)}"] if group.where else []
    facets += [f"near: {_text(group.near)}"] if group.near else []
    return f"  {_text(group.name)}: {{{', '.join(facets)}}}"


def _robot(robot: RobotEntry) -> Iterator[str]:
    yield f"  {_text(robot.name)}:"
    facets = (("page", robot.page), ("hash", robot.hash), ("host", robot.host), ("isolate", robot.isolate))
    for key, value in facets:
        if value is not None:
            yield f"    {key}: {_word(value)}"
    if robot.settings:
        yield "    settings:"
        yield from (f"      {name}: {_word(value)}" for name, value in robot.settings.items())
    if robot.role is not None:
        yield f"    role: {_word(robot.role)}"
    if robot.slots:
        yield "    slots:"
        for slot, children in robot.slots.items():
            names = [_word(child) for child in children]
            yield f"      {_text(slot)}: {names[0] if len(names) == 1 else '[' + ', '.join(names) + ']'}"
    if robot.watches:
        yield "    watches:"
        yield from (f"      {_text(slot)}: {_word(watched)}" for slot, watched in robot.watches.items())


def _word(word: Word) -> str:
    return _text(word.text)


def _text(text: str) -> str:
    return text if _BARE.fullmatch(text) else json.dumps(text, ensure_ascii=False)
