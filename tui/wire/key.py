"""`robotree wire key FILE`: make a file with a key, for `--key FILE`."""

from __future__ import annotations

import getpass
import json
import sys
from pathlib import Path

from robotree.protocol.links.keyring import Keyring, create
from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import put

ALL = "*"


def run(line: Line) -> int:
    """Make the file, and print the fingerprint of its key."""
    path, pattern = Path(line.text("FILE")), line.text("--links", ALL)
    create(path, pattern, passphrase() if line.flag("--passphrase") else None)
    ((links, key),) = Keyring(path).keys
    if line.flag("--json"):
        put(json.dumps({"file": str(path), "links": links, "fingerprint": key.fingerprint}))
    else:
        put(f"{path}: a key for links {links}, fingerprint {key.fingerprint}; keep the file to yourself")
    return exit_codes.DONE


def passphrase() -> str:
    """Ask for a passphrase; it is never an argument, for everybody can read those.

    Raises:
        ValueRefused: it is empty.
    """
    text = getpass.getpass("passphrase: ") if sys.stdin.isatty() else sys.stdin.readline().rstrip("\r\n")
    if not text:
        raise ValueRefused("PASSPHRASE", "the passphrase is empty; type the one that the ground station has")
    return text
