"""Other keys for what the screen can do: a file of the operator's, or a preset for another tool's habits.

    # $XDG_CONFIG_HOME/robotree/keys.toml (~/.config/robotree/keys.toml), or the file in $ROBOTREE_KEYS
    preset = "k9s"
    [keys]
    enslave = "E"
    panel.run = "ctrl+e, f5"

The names on the left are those of the registry: verbs (`line.actions`), and `page.name` for the keys of the
other pages (`line.page_keys`). A file that is wrong anywhere is refused whole: half a keymap is a trap.
The protective stop keeps its keys whatever the file says.
"""

from __future__ import annotations

import os
import re
import tomllib
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, cast

from textual.keys import KEY_NAME_REPLACEMENTS, Keys

from robotree import files
from robotree.tui.errors import BadKeymap
from robotree.tui.line.action import Scope, Where, spell
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.line.page_keys import PAGE_KEYS

VARIABLE = "ROBOTREE_KEYS"
"""Names another file."""

LARGEST = 100_000
"""Bytes of a keymap file that are read."""

PRESETS: Mapping[str, Mapping[str, str]] = {
    "robotree": {},
    "k9s": {"show": "d,y", "delete": "ctrl+d", "log": "l", "robots": "0", "wide": "ctrl+w", "skeleton": "Z"},
}
"""By name: keys by what they do. k9s' space marks and its ctrl+k kills without a question: ours do not."""

_MODIFIER = re.compile(r"(ctrl|shift|alt|super)\+(?=.)")
_NAMED = {str(key.value) for key in Keys} | {f"f{number}" for number in range(1, 25)}
_MAIN = "main"
"""The page of the registry's verbs; the others are those of `PAGE_KEYS`."""


@cache
def default_keys() -> Mapping[str, str]:
    """Return the keys of the registry: by what they do, several of them separated by commas."""
    verbs = {action.verb: action.key for action in ACTIONS if action.key and Where.SCREEN in action.where}
    return verbs | {key.id: key.key for key in PAGE_KEYS}


@dataclass(frozen=True, slots=True)
class Keymap:
    """All keys, with the changes of an operator."""

    changed: Mapping[str, str] = field(default_factory=dict[str, str])
    """Keys by what they do, as `App.set_keymap` takes them."""

    def keys(self, name: str) -> tuple[str, ...]:
        """Return the keys of a verb or of `page.name`; none: it has none."""
        found = self.changed.get(name) or default_keys().get(name, "")
        return tuple(found.split(",")) if found else ()

    def spelled(self, name: str) -> str:
        """Return the first of these keys as it is printed on keyboards."""
        return next(map(spell, self.keys(name)), "")


def load() -> Keymap:
    """Read the operator's keymap file, if there is one.

    Raises:
        BadKeymap: it cannot be read, or something in it is wrong.
    """
    named = os.environ.get(VARIABLE, "")
    config = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    path = Path(named or f"{config}/robotree/keys.toml").expanduser()
    try:
        text = files.text(path, LARGEST)
    except FileNotFoundError:
        if not named:
            return Keymap()
        raise BadKeymap(str(path), f"there is no such file; ${VARIABLE} names it") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise BadKeymap(str(path), f"it cannot be read: {reason}") from None
    return read(text, str(path))


def read(text: str, path: str) -> Keymap:
    """Read a keymap.

    Args:
        text: TOML.
        path: named in errors.

    Raises:
        BadKeymap: something in it is wrong.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadKeymap(path, f"it is no TOML: {error}") from None
    if strange := document.keys() - {"preset", "keys"}:
        raise BadKeymap(path, f"{min(strange)!r} means nothing here; write preset = ... and [keys]")
    preset = document.get("preset", "robotree")
    if not isinstance(preset, str) or preset not in PRESETS:
        raise BadKeymap(path, f"there is no preset {preset!r}; there are {', '.join(PRESETS)}")
    if not isinstance(table := document.get("keys", {}), dict):
        raise BadKeymap(path, "keys must be a table; write [keys] and below it a line for each")
    own = {name: _keys(name, keys, path) for name, keys in _flat(cast("dict[str, Any]", table))}
    changed = {**PRESETS[preset], **own}
    if problem := _clash(changed):
        raise BadKeymap(path, problem)
    return Keymap(changed)


def _flat(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield names and values: TOML reads `panel.run = ...` as a table in a table."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _flat(cast("dict[str, Any]", value), f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _keys(name: str, value: Any, path: str) -> str:
    """Return the keys of a line of the file, as Textual names them."""
    known = default_keys()
    if name not in known:
        near = get_close_matches(name, known, n=2)
        hint = f"did you mean {' or '.join(near)}?" if near else "`?` on the screen shows what there is"
        raise BadKeymap(path, f"nothing is named {name!r}; {hint}")
    if name == "stop":
        raise BadKeymap(path, f"the protective stop keeps its keys, {_stop_keys()}")
    if not isinstance(value, str) or not value.strip():
        raise BadKeymap(path, f'{name} must be a text with one or more keys, for example {name} = "f5, y"')
    found = [_key(one.strip()) for one in ([value] if value == "," else value.split(","))]
    if "" in found:
        raise BadKeymap(path, f"{name}: {value!r} is no key; write for example y, Y, ctrl+y, f5 or pageup")
    if {*found} & {BY_VERB["stop"].key, BY_VERB["stop"].typing_key}:
        raise BadKeymap(path, f"{name}: {_stop_keys()} are the protective stop's, on every page")
    for action in ACTIONS:
        if action.typing_key in found:
            raise BadKeymap(path, f"{name}: {action.typing_key} is the key of {action.verb} on every page")
    return ",".join(found)


def _stop_keys() -> str:
    return f"{spell(BY_VERB['stop'].key)} and {BY_VERB['stop'].typing_key}"


def _key(text: str) -> str:
    """Return a key as Textual names it; empty: it is none."""
    plain = _MODIFIER.sub("", text)
    if len(plain) == 1 and plain.isprintable() and not plain.isspace():
        name = plain if plain.isalnum() else _character(plain)
        return text[: len(text) - 1] + name
    return text if plain in _NAMED or plain in KEY_NAME_REPLACEMENTS.values() else ""


def _character(letter: str) -> str:
    """Return the name of a sign, as Textual makes it from Unicode's: `question_mark`."""
    name = unicodedata.name(letter, letter).lower().replace("-", "_").replace(" ", "_")
    return KEY_NAME_REPLACEMENTS.get(name, name)


def _clash(changed: Mapping[str, str]) -> str:
    """Return which key would have two meanings on one page; empty: none."""
    program = [action.verb for action in ACTIONS if action.scope is Scope.PROGRAM and action.key]
    main = [action.verb for action in ACTIONS if action.scope is Scope.PAGE and action.key]
    pages: dict[str, list[str]] = {_MAIN: [*program, *main]}
    for key in PAGE_KEYS:
        pages.setdefault(key.page, [*program] if key.page not in {"question", "text"} else []).append(key.id)
    keymap = Keymap(changed)
    for names in pages.values():
        if problem := _twice(keymap, names):
            return problem
    return ""


def _twice(keymap: Keymap, names: Iterable[str]) -> str:
    taken: dict[str, str] = {}
    for name in names:
        for key in keymap.keys(name):
            if key in taken:
                return (
                    f"{spell(key)} would be the key of {taken[key]} and of {name}; give one of them another"
                )
            taken[key] = name
    return ""
