"""The keys of the links that a command opens: `--key FILE`, or `$ROBOTREE_KEY`.

The file is one that `robotree wire key FILE` makes. Its path is all that command lines, logs and errors show.
"""

from __future__ import annotations

import os
import secrets
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from robotree.protocol.links.keyring import Keyring
from robotree.protocol.links.security import UNSIGNED, Sealing, Security, persisting
from robotree.tui.line.grammar import Line

VARIABLE = "ROBOTREE_KEY"
NOTHING = "none"
"""What is given instead of a file by who wants links without keys although the variable is set."""


@asynccontextmanager
async def securing(line: Line) -> AsyncGenerator[Sealing]:
    """Read the keys for what a line starts, and keep their time inside the block.

    Whoever gives a file wants what it opens to be signed: an address that the file has no key for is refused.

    Yields:
        What signs the links; without a file, nothing does.

    Raises:
        KeyFileError: the file cannot be used, or has no key for an address of the line.
        BadUrl: an address means nothing.
    """
    given = line.text("--key") or os.environ.get(VARIABLE) or NOTHING
    if given == NOTHING:
        yield UNSIGNED
        return
    keys = Keyring(Path(given))
    for option in ("--listen", "--connect"):
        if line.text(option):
            keys.require(line.text(option), listening=option == "--listen")
    for address in line.many("URL"):
        keys.require(address, listening=False)
    link = secrets.randbelow(256)
    async with persisting(Security(keys, time.time, first_link=link)) as security:
        yield security
