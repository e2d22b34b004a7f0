"""The dialect: robotree.xml is the source of truth; table.json and the typed messages are generated from it.

Generate both with `python -m robotree.protocol.dialect` after each change of the XML.
"""

from robotree.protocol.dialect.table import Definition, Field, by_name, definitions

__all__ = ["Definition", "Field", "by_name", "definitions"]
