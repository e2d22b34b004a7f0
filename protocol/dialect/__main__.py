"""`python -m robotree.protocol.dialect`: generate the table and the typed messages from the XML."""

from __future__ import annotations

import sys

from robotree.protocol.dialect import classes
from robotree.protocol.dialect import compile as compiler
from robotree.protocol.dialect.table import TABLE
from robotree.protocol.errors import DialectError

CLASSES = TABLE.parents[1] / "messages" / "__init__.py"
"""The module that `classes.source` writes."""


def main() -> int:
    """Write both; exit code 1 and one sentence when the XML is wrong."""
    try:
        parsed = compiler.parse()
        table, source = compiler.table_of(parsed), classes.source(parsed)
    except DialectError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    TABLE.write_bytes(compiler.dump(table))
    CLASSES.write_text(source, encoding="utf-8")
    sys.stdout.write(f"{TABLE.name}: {len(table)} messages\n{CLASSES.parent.name}/{CLASSES.name}: written\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
