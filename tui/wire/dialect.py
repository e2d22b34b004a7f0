"""`robotree wire dialect --lang LANGUAGE OUT`: our dialect, or yours, for programs in other languages."""

from __future__ import annotations

import json
from pathlib import Path

from robotree.protocol.dialect import languages
from robotree.protocol.dialect.compile import DIALECT
from robotree.tui import exit_codes
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import put


def dialect(line: Line, _realm: str) -> int:
    """Write the dialect, and say what was written."""
    dialect = Path(line.text("--xml")) if line.text("--xml") else DIALECT
    written = languages.write(
        line.text("--lang"), Path(line.text("OUT")), dialect, base=line.text("--include")
    )
    if line.flag("--json"):
        put(json.dumps({"files": [str(path) for path in written]}))
    else:
        put(f"{line.text('OUT')}: {len(written)} file{'s' * (len(written) != 1)}")
    return exit_codes.DONE
