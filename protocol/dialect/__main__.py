"""`python -m robotree.protocol.dialect`: generate table.json from robotree.xml again."""

from __future__ import annotations

import sys

from robotree.protocol.dialect import compile as compiler
from robotree.protocol.dialect.table import TABLE
from robotree.protocol.errors import DialectError


def main() -> int:
    """Write the table; exit code 1 and one sentence when the XML is wrong."""
    try:
        table = compiler.build()
    except DialectError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    TABLE.write_bytes(compiler.dump(table))
    sys.stdout.write(f"{TABLE.name}: {len(table)} messages\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
