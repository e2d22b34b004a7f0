"""`robotree wire dialect` and `dissector`: our dialect, or yours, for other languages and for Wireshark."""

from __future__ import annotations

from pathlib import Path

from robotree.protocol.dialect import languages
from robotree.protocol.dialect.compile import DIALECT
from robotree.protocol.dialect.errors import TargetTaken, writing
from robotree.tui import exit_codes
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import answer, note, put_data


def dialect(line: Line, _realm: str) -> int:
    """Write the dialect, and say what was written."""
    dialect = Path(line.text("--xml")) if line.text("--xml") else DIALECT
    written = languages.write(
        line.text("--lang"), Path(line.text("OUT")), dialect, base=line.text("--include")
    )
    text = f"{line.text('OUT')}: {len(written)} file{'s' * (len(written) != 1)}"
    answer(text, lambda: {"files": [str(path) for path in written]})
    return exit_codes.DONE


def dissector(line: Line, _realm: str) -> int:
    """Write the dissector to the file, or to standard output."""
    port, refusal = line.text("--port"), "is no port; write a number up to 65535"
    ports = [values.whole("PORT", port, 1, 65535, refusal)] if port else []
    text = languages.dissector(ports, Path(line.text("--xml")) if line.text("--xml") else DIALECT)
    if not line.text("FILE"):
        answer(text.removesuffix("\n"), lambda: {"lua": text})
        return exit_codes.DONE
    path = Path(line.text("FILE"))
    try:
        file = path.open("x", encoding="utf-8")
    except FileExistsError:
        raise TargetTaken(path) from None
    with writing(path), file:
        file.write(text)
    note(f"{path}: use it as `wireshark -X lua_script:{path}`")
    if line.flag("--json"):
        put_data({"file": str(path)})
    return exit_codes.DONE
