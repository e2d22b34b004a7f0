"""The dialect in other languages, by pymavlink's generator, with the base headers it needs.

The generator knows more languages than are offered: its Ada fails, its TypeScript has wrong types, and its
Lua leaves the file open. JavaScript is written by us, for the package node-mavlink.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from robotree.files import overwrite
from robotree.protocol.dialect import compile as compiler
from robotree.protocol.dialect import javascript
from robotree.protocol.dialect.errors import NoFile, TargetTaken, UnknownLanguage, writing

if TYPE_CHECKING:
    from collections.abc import Sequence


class Language(msgspec.Struct, frozen=True):
    """One language that the dialect can be had in."""

    generator: str
    """Its name in pymavlink; empty: the generator is ours."""
    suffix: str = ""
    """Of the one file that is made; empty: it is a folder."""


LANGUAGES = {
    "c": Language("C"),
    "c++": Language("C++11"),
    "csharp": Language("CS"),
    "java": Language("Java"),
    "javascript": Language("", ".js"),
    "objc": Language("ObjC"),
    "python": Language("Python3", ".py"),
    "swift": Language("Swift"),
    "wireshark": Language("WLua", ".lua"),
}
"""Every language, by the name that people use."""
XML = "xml"
"""No language: the dialect itself and all that it includes, for generators of other people."""


def names() -> tuple[str, ...]:
    """The names of languages that `write` takes."""
    return (*LANGUAGES, XML)


def write(name: str, target: Path, dialect: Path = compiler.DIALECT, *, base: str = "") -> list[Path]:
    """Write the dialect in one language.

    Args:
        name: one of `names()`.
        target: the folder to make; for a language of one file that file.
        dialect: the XML.
        base: a base dialect that is written with it, such as `ardupilotmega`; empty: none.

    Returns:
        What was written, sorted.

    Raises:
        UnknownLanguage: it is not offered.
        UnknownBase: pymavlink brings no such base dialect.
        NoFile: the target of a language of one file is a folder.
        TargetTaken: there is something at the target already.
        NotWritten: it cannot be written, as on a full disk.
        DialectError: the XML is wrong.
    """
    if name not in names():
        raise UnknownLanguage(name, names())
    suffix = "" if name == XML else LANGUAGES[name].suffix
    if suffix and target.is_dir():
        raise NoFile(target, name, suffix)
    if target.is_file() or (target.is_dir() and any(target.iterdir())):
        raise TargetTaken(target)
    with compiler.beside(base, dialect) as xml:
        if name == XML:
            return _write_xml(target, xml)
        with tempfile.TemporaryDirectory(prefix="robotree-dialect-") as folder:
            made = Path(folder) / f"out{suffix}"
            if generator := LANGUAGES[name].generator:
                compiler.generate(made, xml=xml, language=generator)
            else:
                made.write_text(javascript.source(compiler.checked(xml)), encoding="utf-8")
            return _place(made, target)


def dissector(ports: Sequence[int] = (), dialect: Path = compiler.DIALECT) -> str:
    """The text of the dissector for Wireshark and tshark: Lua, bound to further ports.

    Wireshark knows MAVLink by its usual ports (TCP 5760 to 5763; UDP 14550, 14580 and 18570) and by the link
    type USER0 of a capture file. It dissects each TCP segment by itself, so it sees all frames of a sender
    that writes whole frames, as robotree does.

    Args:
        ports: TCP and UDP ports on which MAVLink is spoken.
        dialect: the XML.

    Raises:
        DialectError: the dialect does not compile.
    """
    with tempfile.TemporaryDirectory(prefix="robotree-dissector-") as folder:
        target = Path(folder) / "robotree.lua"
        write("wireshark", target, dialect)
        text = target.read_text(encoding="utf-8")
    return text + "".join(
        f'DissectorTable.get("{transport}.port"):add({port}, mavlink_proto)\n'
        for port in ports
        for transport in ("tcp", "udp")
    )


def _place(made: Path, target: Path) -> list[Path]:
    if made.is_file():
        return [_copy(made, target)]
    return [
        _copy(path, target / path.relative_to(made)) for path in sorted(made.rglob("*")) if path.is_file()
    ]


def _copy(made: Path, target: Path) -> Path:
    with writing(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        overwrite(target, made.read_bytes())
        return target


def _write_xml(target: Path, dialect: Path) -> list[Path]:
    """Copy the dialect and what it includes, and no more."""
    names = [Path(parsed.filename).name for parsed in compiler.parse(dialect)]
    with compiler.workspace(dialect) as copy:
        return sorted(_copy(copy.parent / name, target / name) for name in names)
