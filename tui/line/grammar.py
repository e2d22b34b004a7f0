"""The one grammar of robotree: command line, `:` prompt and session scripts read the same lines.

A verb's usage string is both its help and its parser:

    create FILE as NAME [on HOST]
    call ROBOT.COMMAND [PARAMETER=VALUE …] [--within TIME]
    wire decode FILE

The lower-case words at the beginning are the verb. UPPER CASE is a value to fill in, lower case a word to
type as it is, `[…]` may be left out, `…` repeats the value before it, `--option` may stand anywhere behind
the verb; of options with `|` between them only one. Values that begin with `--` are given after a bare `--`.
Pure: text in, values out.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from itertools import takewhile
from types import MappingProxyType
from typing import NamedTuple

from robotree.tui.errors import BadLine, UnknownVerb

Value = str | tuple[str, ...] | bool
MORE, OR = "…", "|"
LONGEST_VERB = 2
"""Words of a verb, at most."""
SHORT: Mapping[str, str] = MappingProxyType({"-k": "select", "-x": "exitfirst"})
"""The short forms of options, as pytest has them; another verb takes such a word as any other."""
_NEAR = 0.7
"""Likeness of a word and a verb, 0 to 1, from which on the verb is suggested."""

_GROUP, _OPTION = r"\[([^]]*)]", r"--([\w-]+)"
_CHOICE = r"--[\w-]+(?: [A-Z]+)?(?: \| --[\w-]+(?: [A-Z]+)?)*"
"""Options of which one is taken; with nothing beside it, that one. Compiled when first used."""


class Word(NamedTuple):
    """A word to type as it is."""

    text: str


class Blank(NamedTuple):
    """A value to fill in."""

    name: str
    repeated: bool = False


class Group(NamedTuple):
    """Parts that come together or not at all."""

    parts: tuple[Part, ...]


Part = Word | Blank | Group


class Shape(NamedTuple):
    """How the lines of one verb look."""

    verb: str
    usage: str
    parts: tuple[Part, ...]
    options: Mapping[str, str]
    """Option without its dashes -> name of its value; empty for a flag."""
    rivals: tuple[tuple[str, ...], ...] = ()
    """Options of which only one may be given."""
    needed: tuple[tuple[str, ...], ...] = ()
    """Options of which one must be given."""


class Line(NamedTuple):
    """One line, understood: its verb and the values by the names of the blanks (options with dashes)."""

    verb: str
    values: Mapping[str, Value] = MappingProxyType({})
    given: float | None = None
    """[s, CLOCK_MONOTONIC] When a person gave it; None: now."""
    order: str = ""
    """Id of the order to stop that has been sent for it already; empty: none has."""

    def text(self, name: str, default: str = "") -> str:
        """Return a single value, or the default when it was left out."""
        value = self.values.get(name, default)
        return value if isinstance(value, str) else default

    def many(self, name: str) -> tuple[str, ...]:
        """Return a repeated value; empty when it was left out."""
        value = self.values.get(name, ())
        return value if isinstance(value, tuple) else ()

    def flag(self, name: str) -> bool:
        """Whether a flag was given."""
        return self.values.get(name) is True


@cache
def verb(usage: str) -> str:
    """Return the lower-case words with which a usage string begins."""
    words = takewhile(str.islower, usage.split())
    return " ".join(takewhile(lambda word: word.replace("-", "_").isidentifier() and word[0] != "-", words))


@cache
def shape(usage: str) -> Shape:
    """Compile a usage string.

    Args:
        usage: verb first, as described in the module's docstring.

    Returns:
        The shape that `parse` wants.
    """
    tokens = usage.replace("[", " [ ").replace("]", " ] ").split()
    begins = verb(usage)
    tokens = tokens[begins.count(" ") + 1 :]
    options: dict[str, str] = {}
    parts, rest = _parts(tokens, options)
    if rest:
        raise ValueError(f"usage has a ']' too many: {usage}")
    choices = [tuple(re.findall(_OPTION, choice)) for choice in re.findall(_CHOICE, usage)]
    always = re.findall(_CHOICE, re.sub(_GROUP, "", usage))
    needed = [tuple(re.findall(_OPTION, choice)) for choice in always]
    rivals = tuple(choice for choice in choices if len(choice) > 1)
    return Shape(begins, usage, parts, options, rivals, tuple(needed))


def _parts(tokens: list[str], options: dict[str, str]) -> tuple[tuple[Part, ...], list[str]]:
    """Read parts up to the end or a closing bracket; options are put aside."""
    parts: list[Part] = []
    while tokens and tokens[0] != "]":
        first, *tokens = tokens
        if first == "[":
            inner, tokens = _parts(tokens, options)
            tokens = tokens[1:]
            parts += [Group(inner)] if inner else []
        elif first.startswith("--"):
            named = bool(tokens) and tokens[0].isupper()
            options[first[2:]] = tokens[0] if named else ""
            tokens = tokens[1:] if named else tokens
        elif first.isupper():
            repeated = tokens[:1] == [MORE]
            tokens = tokens[1:] if repeated else tokens
            parts.append(Blank(first, repeated))
        elif first != OR:
            parts.append(Word(first))
    return tuple(parts), tokens


_NEXT_TO = 0.9
"""How much like another verb of two words must be what is no line of this one: `alarms ack`, `alarm ack`."""

_SAID = re.compile(r"say\s+(?!-)(.*\w'\w.*)")
"""A line to other operators, with an apostrophe in a word."""


def split(text: str) -> tuple[str, ...]:
    """Cut a line into words; quotes hold words together, `#` begins a comment.

    What people say to each other has apostrophes: where it has, all behind `say` is one text, as it is.

    Raises:
        BadLine: a quote is not closed.
    """
    import shlex

    if said := _SAID.fullmatch(text.strip()):
        return "say", "--", said[1]
    try:
        return tuple(shlex.split(text, comments=True))
    except ValueError as error:
        raise BadLine(f"cannot read {text.strip()!r}: {str(error).lower()}", "") from None


def leading(words: Sequence[str], everywhere: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """Part the options for every verb that stand before the verb from the rest of the line."""
    count = 0
    while count < len(words) and words[count].startswith("--") and words[count] != "--":
        name, given, _ = words[count][2:].partition("=")
        count += 2 if everywhere.get(name) and not given else 1
    return list(words[:count]), list(words[count:])


def parse(
    words: Iterable[str],
    shapes: Mapping[str, Shape],
    everywhere: Mapping[str, str],
    internal: Mapping[str, str] | None = None,
) -> Line:
    """Understand one line.

    Args:
        words: the verb and its values, as `split` or a shell gives them.
        shapes: the verbs.
        everywhere: options that every verb takes, as in `Shape.options`; they may also stand before the verb.
        internal: the same, but for programs: no person is told of them.

    Returns:
        The verb and its values.

    Raises:
        UnknownVerb: there is no such verb.
        BadLine: a value is missing or given twice, one is too many, or an option is unknown.
    """
    before, given = leading(list(words), everywhere)
    verb = verb_of(given, shapes)
    wanted = shapes[verb]
    known = {**everywhere, **wanted.options}
    plain, values = _take_options(
        [*before, *given[verb.count(" ") + 1 :]], known, internal or {}, wanted.usage
    )
    for rivals in wanted.rivals:
        if len(both := [f"--{rival}" for rival in rivals if f"--{rival}" in values]) > 1:
            raise BadLine(f"{wanted.verb}: take only one of {' and '.join(both)}", wanted.usage)
    for choice in wanted.needed:
        if not any(f"--{one}" in values for one in choice):
            raise BadLine(f"{wanted.verb}: {_either(choice)} is missing", wanted.usage)
    found = _match(wanted.parts, tuple(plain))
    if found is None:
        import difflib

        near = difflib.get_close_matches(f"{verb} {' '.join(plain[:1])}", set(shapes) - {verb}, 2, _NEXT_TO)
        hint = f" (did you mean {' or '.join(near)}?)" if near else ""
        raise BadLine(_complaint(wanted, plain) + hint, wanted.usage)
    return Line(verb, {**values, **found})


def _either(choice: Iterable[str]) -> str:
    return " or ".join(f"--{one}" for one in choice)


def verb_of(words: Sequence[str], shapes: Mapping[str, Shape]) -> str:
    """Return the verb with which a line begins; of two the longer one.

    Raises:
        UnknownVerb: it begins with none.
        BadLine: it is only the first of two words.
    """
    words = list(takewhile(lambda word: not word.startswith("--"), words[:LONGEST_VERB]))
    for count in range(len(words), 0, -1):
        if (verb := " ".join(words[:count])) in shapes:
            return verb
    if not words:
        raise UnknownVerb("", ())
    family = [verb for verb in shapes if verb.startswith(f"{words[0]} ")]
    if family and len(words) == 1:
        known = ", ".join(verb.partition(" ")[2] for verb in family)
        raise BadLine(f"{words[0]} needs a second word: {known}", f"{words[0]} VERB …")
    import difflib

    asked = " ".join(words) if family else words[0]
    near = difflib.get_close_matches(asked, family or shapes, n=2, cutoff=_NEAR)
    raise UnknownVerb(asked, tuple(near or family))


def form(line: Line, shapes: Mapping[str, Shape]) -> str:
    """Write a line so that `split` and `parse` read the same values again."""
    import shlex

    wanted = shapes[line.verb]
    words = [
        *line.verb.split(),
        *(text for text, _ in _options_of(line)),
        *(["--"] if _needs_guard(line) else []),
    ]
    words += _written(wanted.parts, line.values)
    return shlex.join(words)


def _options_of(line: Line) -> Iterable[tuple[str, str]]:
    for name, value in line.values.items():
        if name.startswith("--") and value is True:
            yield name, name
        elif name.startswith("--") and isinstance(value, str):
            yield f"{name}={value}", name


def _needs_guard(line: Line) -> bool:
    values = [value for name, value in line.values.items() if not name.startswith("--")]
    texts = [text for value in values for text in (value if isinstance(value, tuple) else (str(value),))]
    return any(text.startswith("--") for text in texts)


def _written(parts: tuple[Part, ...], values: Mapping[str, Value]) -> list[str]:
    words: list[str] = []
    for part in parts:
        match part:
            case Word(text):
                words.append(text)
            case Blank(name):
                value = values.get(name, ())
                words += value if isinstance(value, tuple) else [str(value)]
            case Group(inner):
                given = any(isinstance(one, Blank) and one.name in values for one in inner)
                words += _written(inner, values) if given else []
    return words


def _take_options(
    words: list[str], known: Mapping[str, str], internal: Mapping[str, str], usage: str
) -> tuple[list[str], dict[str, Value]]:
    """Part the options from the plain words; a bare `--` ends the options."""
    options = {**known, **internal}
    plain: list[str] = []
    values: dict[str, Value] = {}
    queue = list(words)
    while queue:
        word = _long(queue.pop(0), options)
        if word == "--":
            return plain + queue, values
        if not word.startswith("--"):
            plain.append(word)
            continue
        name, given, value = word[2:].partition("=")
        if name not in options:
            raise BadLine(f"unknown option --{name} (known: {', '.join(f'--{one}' for one in known)})", usage)
        if not options[name]:
            if given:
                raise BadLine(f"--{name} takes no value", usage)
            values[f"--{name}"] = True
            continue
        if not given:
            if not queue:
                raise BadLine(f"--{name} needs a {options[name]}", usage)
            value = queue.pop(0)
        if f"--{name}" in values:
            raise BadLine(f"--{name} is given twice", usage)
        values[f"--{name}"] = value
    return plain, values


def _long(word: str, options: Mapping[str, str]) -> str:
    """Return the long form of an option that a verb has."""
    return f"--{SHORT[word]}" if SHORT.get(word) in options else word


def _match(parts: tuple[Part, ...], words: tuple[str, ...]) -> dict[str, Value] | None:
    """Match all words against all parts; groups are tried before they are left out."""
    if not parts:
        return {} if not words else None
    first, rest = parts[0], parts[1:]
    match first:
        case Word(text):
            return _match(rest, words[1:]) if words[:1] == (text,) else None
        case Group(inner):
            return _first(_match((*inner, *rest), words), _match(rest, words))
        case Blank(name, repeated=False):
            return _joined({name: words[0]}, _match(rest, words[1:])) if words else None
        case Blank(name):
            for count in range(len(words), 0, -1):
                found = _joined({name: words[:count]}, _match(rest, words[count:]))
                if found is not None:
                    return found
            return None


def _first(one: dict[str, Value] | None, other: dict[str, Value] | None) -> dict[str, Value] | None:
    return one if one is not None else other


def _joined(one: dict[str, Value], other: dict[str, Value] | None) -> dict[str, Value] | None:
    return None if other is None else {**one, **other}


def _complaint(wanted: Shape, words: list[str]) -> str:
    """Say what is missing, or what is too much."""
    needed = [part for part in wanted.parts if not isinstance(part, Group)]
    for position, part in enumerate(needed):
        given = words[position] if position < len(words) else None
        if given is None:
            what = repr(part.text) if isinstance(part, Word) else part.name
            return f"{wanted.verb}: {what} is missing"
        if isinstance(part, Word) and part.text != given:
            return f"{wanted.verb}: expected {part.text!r} where {given!r} stands"
    return f"{wanted.verb}: {' '.join(words[len(needed) :])!r} is more than it takes"
