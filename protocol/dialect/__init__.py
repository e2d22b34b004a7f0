"""The dialect: robotree.xml is the source of truth, table.json what the codec loads.

Regenerate the table with `python -m robotree.protocol.dialect`.
"""

from robotree.protocol.dialect.table import Definition, Field, by_name, definitions

__all__ = ["Definition", "Field", "by_name", "definitions"]
