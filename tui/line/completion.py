"""Completing a half-typed line from the verbs' shapes and the names of the realm. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import TYPE_CHECKING

from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.grammar import Blank, Group, Part, Shape, Word

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import RobotDescription

OF_THE_REALM = frozenset(
    {
        "NAME",
        "NAME|KEY",
        "GROUP",
        "ROBOT",
        "CHILD",
        "VIEW",
        "HOST",
        "PARENT.SLOT",
        "ROBOT.COMMAND",
        "PARAMETER=VALUE",
    }
)
"""The blanks whose words are names of the realm."""


@dataclass(frozen=True, slots=True)
class Words:
    """The names that can be completed now, by the placeholders of the usages."""

    blanks: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """For example NAME, CHILD, PARENT.SLOT, ROBOT.COMMAND, VIEW, HOST."""
    verbs: Mapping[str, Shape] = field(default_factory=lambda: shapes(Where.PROMPT))
    """The verbs that are there."""
    parameters: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """Names of PARAMETER=VALUE: of a command by `ROBOT.COMMAND`, of the settings of a robot by its name."""
    everywhere: Mapping[str, str] = field(default_factory=dict[str, str])
    """Options that every verb takes, as in `Shape.options`."""


def words_of(
    robots: Iterable[RobotDescription],
    *,
    free: Iterable[str],
    views: Iterable[str],
    hosts: Iterable[str],
    verbs: Mapping[str, Shape],
    everywhere: Mapping[str, str] | None = None,
    groups: Iterable[str] = (),
) -> Words:
    """Return what can be named in a realm.

    Args:
        robots: that have described themselves.
        free: names of the robots that no other one commands.
        views: their names.
        hosts: their names.
        verbs: that are there, by their words.
        everywhere: options that every verb takes, as in `Shape.options`.
        groups: their names.
    """
    groups = sorted(groups)
    described = sorted(robots, key=lambda robot: robot.name)
    commands = {f"{robot.name}.{command.name}": command for robot in described for command in robot.commands}
    blanks = {
        "NAME": sorted({*free, *(robot.name for robot in described), *groups}),
        "ROBOT": sorted({*free, *(robot.name for robot in described)}),
        "GROUP": groups,
        "NAME|KEY": sorted({*free, *(robot.name for robot in described)}),
        "CHILD": [*sorted(free), "where"],
        "ANSWER": ["done", "again", "abort"],
        "VIEW": sorted(views),
        "HOST": sorted(hosts),
        "PARENT.SLOT": [place for robot in described for place in _places(robot)],
        "ROBOT.COMMAND": list(commands),
    }
    parameters = {path: [*command.by_name] for path, command in commands.items()}
    parameters |= {robot.name: parameters.get(f"{robot.name}.set", []) for robot in described}
    return Words(blanks, verbs, parameters, everywhere or {})


def _places(robot: RobotDescription) -> list[str]:
    """Return the slots of a robot as `PARENT.SLOT`, and its groups."""
    names = dict.fromkeys(slot.group for slot in robot.slots if slot.group) | dict.fromkeys(
        slot.name for slot in robot.slots
    )
    return [f"{robot.name}.{name}" for name in names]


def candidates(text: str, words: Words) -> tuple[str, ...]:
    """Return the words that the last one may become.

    Args:
        text: what stands before the cursor; after a space every word that may come next fits.
        words: what can be named.

    Returns:
        The words, each once; what was typed in full already is none of them.
    """
    *before, last = text.split(" ")
    given = [word for word in before if word]
    return following(given, last, words) if given or last else ()


def following(given: Sequence[str], last: str, words: Words) -> tuple[str, ...]:
    """Return the words that `last`, a word half typed, may become behind the words that were given."""
    known = (word for word in _known(given, words) if word.startswith(last) and word != last)
    return tuple(dict.fromkeys(known))


def complete(text: str, words: Words) -> str | None:
    """Return the line with its last word completed as far as there is no choice.

    Args:
        text: what stands before the cursor.
        words: what can be named.

    Returns:
        A longer line that begins with `text`, or None when nothing fits or more must be typed first.
    """
    last = text.rpartition(" ")[2]
    found = _shared(candidates(text, words))
    return text + found[len(last) :] if len(found) > len(last) else None


def _shared(words: Sequence[str]) -> str:
    """Return the letters with which all words begin: as far as the first and the last in order agree."""
    both = zip(min(words, default=""), max(words, default=""), strict=False)
    return "".join(one for one, _ in takewhile(lambda pair: pair[0] == pair[1], both))


def _known(given: Sequence[str], words: Words) -> Sequence[str]:
    """Return every word that may come behind those that were given."""
    shape = _shape_of(given, words.verbs)
    if shape is None:
        typed = " ".join(given)
        begun = [verb for verb in words.verbs if not typed or verb.startswith(f"{typed} ")]
        position = len(given)
        return [verb.split()[position] if typed else verb.split()[0] for verb in begun]
    behind = [verb.partition(" ")[2] for verb in words.verbs if verb.startswith(f"{' '.join(given)} ")]
    found = [verb.partition(" ")[0] for verb in behind]
    option = _open_option(given, {**words.everywhere, **shape.options})
    for part in [Blank(option)] if option else expected(given, words):
        if isinstance(part, Word):
            found.append(part.text)
        elif part.name == "PARAMETER=VALUE":
            found += _parameters(given, words)
        else:
            found += words.blanks.get(part.name, ())
    if option:
        return found
    return [*found, *(f"--{name}" for name in (*shape.options, *words.everywhere))]


def _parameters(given: Sequence[str], words: Words) -> list[str]:
    """Return the parameters of the robot or command in the line that have no value yet, with their `=`."""
    names = next((words.parameters[word] for word in given if word in words.parameters), ())
    named = {word.partition("=")[0] for word in given if "=" in word}
    return [f"{name}=" for name in names if name not in named]


def _shape_of(given: Sequence[str], verbs: Mapping[str, Shape]) -> Shape | None:
    """Return the shape of the verb with which a line begins, of two the longer one."""
    return verbs.get(" ".join(given[:2])) or verbs.get(given[0]) if given else None


def _open_option(given: Sequence[str], options: Mapping[str, str]) -> str:
    """Return the name of the value for which the last option waits; empty: it waits for none."""
    last = given[-1] if given else ""
    return options.get(last[2:], "") if last.startswith("--") else ""


def expected(given: Sequence[str], words: Words) -> list[Word | Blank]:
    """Return the parts of the verb's usage that may come next; empty where the verb is not complete."""
    shape = _shape_of(given, words.verbs)
    if shape is None:
        return []
    options = {**words.everywhere, **shape.options}
    if option := _open_option(given, options):
        return [Blank(option)]
    behind = given[len(shape.verb.split()) :]
    before = ["", *behind]
    plain = [
        word
        for word, previous in zip(behind, before, strict=False)
        if not (word.startswith("--") or _open_option([previous], options))
    ]
    flat = _flat(shape.parts)
    if len(plain) < len(flat):
        return flat[len(plain) : len(plain) + 1]
    last = flat[-1] if flat else None
    return [last] if isinstance(last, Blank) and last.repeated else []


def _flat(parts: Sequence[Part]) -> list[Word | Blank]:
    flat: list[Word | Blank] = []
    for part in parts:
        flat += _flat(part.parts) if isinstance(part, Group) else [part]
    return flat
