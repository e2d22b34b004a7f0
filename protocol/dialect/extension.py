"""Further messages for this process: those of somebody's own dialect, beside ours.

They are read, shown and recorded like the base's messages that robotree has no class for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.dialect.compile import build
from robotree.protocol.dialect.table import by_name, definitions
from robotree.protocol.errors import DialectError

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.protocol.dialect.table import Definition


def extend(xml: Path) -> list[str]:
    """Have the messages of a dialect known to every codec and parser of this process.

    Args:
        xml: the dialect; it may include robotree.xml or common.xml, or stand alone.

    Returns:
        The names of the messages that were not known before.

    Raises:
        DialectError: the XML is wrong, or a message is one of ours and another one; nothing was added.
    """
    new = [each for each in build(xml) if not _is_known(each, xml)]
    definitions().update({each.id: each for each in new})
    by_name().update({each.name: each for each in new})
    return [each.name for each in new]


def _is_known(wanted: Definition, xml: Path) -> bool:
    """Whether we have just this message. The checksum's extra byte stands for all its fields."""
    known = definitions().get(wanted.id) or by_name().get(wanted.name)
    if known is None:
        return False
    if (known.id, known.name, known.crc_extra) != (wanted.id, wanted.name, wanted.crc_extra):
        problem = f"{wanted.name} with id {wanted.id} is not the {known.name} with id {known.id} of robotree"
        raise DialectError(str(xml), f"{problem}; choose another name and id")
    return True
