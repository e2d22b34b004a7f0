"""Lists and records as people type them: `[10 cm, 0.2]`, `{x: 0.1, y: 5 cm}`, `open, close`.

One grammar for the command line, the forms of the screen and session scripts. What stands between the signs
stays text; who asks for it knows its type and its unit. Pure.

    value   = list | record | quoted text | text up to the next of , ] ) }
    list    = [ value , value … ]   or   ( value , … );   at the outermost level without the brackets, too
    record  = { name : value , name : value … };   at the outermost level without the braces, too
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, cast

from robotree.vr.base.units import shorten

LONGEST = 100_000
"""Characters."""
DEEPEST = 16
"""Lists and records in each other."""
_KEY = re.compile(r"\w[\w-]*")
_QUOTED_NAME = r"\"((?:[^\"\\]|\\.)*)\"|'((?:[^'\\]|\\.)*)'"
_NAME = re.compile(rf"\s*(?:(\w[\w-]*)|{_QUOTED_NAME})\s*[:=]")
_BARE = re.compile(r"[^,\[\](){}\"']*")
_QUOTED = re.compile(_QUOTED_NAME)
_PAIRS = {"[": "]", "(": ")", "{": "}"}


def read_list(text: str) -> list[Any]:
    """Return the values of a list: texts, lists and dictionaries.

    Raises:
        ValueError: why it cannot be read, as the end of a sentence.
    """
    reader = _Reader(text)
    found = reader.value(0) if reader.next in {"[", "("} else reader.items("", 0)
    reader.expect_end()
    return cast("list[Any]", found)


def read_record(text: str) -> dict[str, Any]:
    """Return the values of a record by name; see `read_list`."""
    reader = _Reader(text)
    found = reader.value(0) if reader.next == "{" else reader.entries("", 0)
    reader.expect_end()
    return cast("dict[str, Any]", found)


def write(value: Any) -> str:
    """Write a plain value so that it is read back as it was."""
    if isinstance(value, Mapping):
        parts = cast("Mapping[str, Any]", value).items()
        named = ((name if _KEY.fullmatch(name) else _in_quotes(name), part) for name, part in parts)
        return f"{{{', '.join(f'{name}: {write(part)}' for name, part in named)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(write, cast('Iterable[Any]', value)))}]"
    if isinstance(value, str):
        bare = _BARE.fullmatch(value) and value == value.strip() and value
        return value if bare else _in_quotes(value)
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    return repr(value) if isinstance(value, float) else str(value)


def _in_quotes(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _unescaped(double: str | None, single: str | None) -> str:
    """Return what stands between double or single quotes."""
    return re.sub(r"\\(.)", r"\1", (single or "") if double is None else double, flags=re.DOTALL)


class _Reader:
    def __init__(self, text: str) -> None:
        if len(text) > LONGEST:
            raise ValueError(f"{shorten(text)} is longer than {LONGEST} characters")
        self.text, self.at = text, 0

    @property
    def next(self) -> str:
        """The next sign that is no blank; empty at the end."""
        while self.at < len(self.text) and self.text[self.at].isspace():
            self.at += 1
        return self.text[self.at : self.at + 1]

    def expect_end(self) -> None:
        if self.next:
            raise ValueError(f"{shorten(self.text)} cannot be read from {shorten(self.text[self.at :])} on")

    def value(self, depth: int) -> Any:
        if depth > DEEPEST:
            raise ValueError(f"{shorten(self.text)} has more than {DEEPEST} levels")
        sign = self.next
        if sign in _PAIRS and sign:
            self.at += 1
            end = _PAIRS[sign]
            return self.entries(end, depth + 1) if sign == "{" else self.items(end, depth + 1)
        quoted = _QUOTED.match(self.text, self.at)
        if quoted:
            self.at = quoted.end()
            return _unescaped(quoted[1], quoted[2])
        bare = _BARE.match(self.text, self.at)
        found = bare[0].strip() if bare else ""
        if not found:
            raise self._unreadable("a value")
        self.at += len(bare[0]) if bare else 0
        return found

    def items(self, end: str, depth: int) -> list[Any]:
        found: list[Any] = []
        while self.next != end:
            found.append(self.value(depth))
            if not self._comma(end):
                break
        self.at += len(end)
        return found

    def entries(self, end: str, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        while self.next != end:
            name = _NAME.match(self.text, self.at)
            if name is None:
                raise self._unreadable("`name: value`")
            self.at = name.end()
            key = name[1] if name[1] is not None else _unescaped(name[2], name[3])
            if key in found:
                raise ValueError(f"{shorten(self.text)} gives {key} twice")
            found[key] = self.value(depth)
            if not self._comma(end):
                break
        self.at += len(end)
        return found

    def _comma(self, end: str) -> bool:
        """Read what stands behind a value; returns whether another one may follow."""
        if self.next == ",":
            self.at += 1
            return True
        if self.next != end:
            missing = f"a comma or {end!r}" if end else "a comma"
            raise self._unreadable(missing)
        return False

    def _unreadable(self, missing: str) -> ValueError:
        place = shorten(self.text[self.at :]) if self.next else "its end"
        return ValueError(f"{shorten(self.text)} cannot be read: {missing} is missing before {place}")
