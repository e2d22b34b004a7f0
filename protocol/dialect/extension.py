"""Further messages for this process: those of somebody's own dialect, beside ours.

They are read, shown and recorded like the base's messages that robotree has no class for; `wire` gives one of
them a class.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from robotree.protocol.dialect.compile import build
from robotree.protocol.dialect.table import FIRST_OWN_ID, by_name, definitions
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
        DialectError: the XML is wrong, or a message is one that is known and another one; nothing was added.
    """
    new = [each for each in _built(xml, _versions(xml)) if not _is_known(each, xml)]
    definitions().update({each.id: each for each in new})
    by_name().update({each.name: each for each in new})
    return [each.name for each in new]


@lru_cache(maxsize=8)
def _built(xml: Path, _versions: frozenset[tuple[str, int]]) -> tuple[Definition, ...]:
    """The table of a dialect, made once: each message of a kind's file names the XML."""
    return tuple(build(xml))


def _versions(xml: Path) -> frozenset[tuple[str, int]]:
    """Tells one state of an XML, and of those beside it that it may include, from another."""
    beside = (each for each in xml.parent.glob("*.xml") if each.exists())
    return frozenset((str(each.resolve()), each.stat().st_mtime_ns) for each in beside)


def _is_known(wanted: Definition, xml: Path) -> bool:
    """Whether just this message is known already, be it in a version with fewer extensions, or with more.

    The checksum's extra byte stands for all fields but extensions, so those are compared one by one.
    """
    known = definitions().get(wanted.id) or by_name().get(wanted.name)
    if known is None:
        return False
    is_same = (known.id, known.name, known.crc_extra) == (wanted.id, wanted.name, wanted.crc_extra)
    if not is_same or any(one != other for one, other in zip(known.fields, wanted.fields, strict=False)):
        other = f"{known.name} with id {known.id} that robotree knows"
        remedy = f"choose another name, and an id from {FIRST_OWN_ID} on"
        raise DialectError(str(xml), f"{wanted.name} with id {wanted.id} is not the {other}; {remedy}")
    return True
