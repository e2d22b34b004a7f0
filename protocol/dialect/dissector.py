"""The dissector for Wireshark and tshark: Lua, by pymavlink's generator, and told of further ports.

Wireshark knows MAVLink by its usual ports (TCP 5760 to 5763; UDP 14550, 14580 and 18570) and by the link type
USER0 of a capture file. It takes apart each TCP segment for itself, so it sees all frames of a speaker that
writes whole frames, as robotree does.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from robotree.protocol.dialect import languages
from robotree.protocol.dialect.compile import DIALECT

if TYPE_CHECKING:
    from collections.abc import Sequence


def dissector(ports: Sequence[int] = (), dialect: Path = DIALECT) -> str:
    """The text of the dissector.

    Args:
        ports: further ports of TCP and UDP on which MAVLink is spoken.
        dialect: the XML.

    Raises:
        DialectError: the dialect does not compile.
    """
    with tempfile.TemporaryDirectory(prefix="robotree-dissector-") as folder:
        target = Path(folder) / "robotree.lua"
        languages.write("wireshark", target, dialect)
        text = target.read_text(encoding="utf-8")
    return text + "".join(
        f'DissectorTable.get("{transport}.port"):add({port}, mavlink_proto)\n'
        for port in ports
        for transport in ("tcp", "udp")
    )
