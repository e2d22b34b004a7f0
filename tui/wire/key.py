"""`robotree wire key FILE`: make a file with a key, or print the key of one controller.

For `--key FILE`, and for programs that have no such file: MAVProxy, QGroundControl, MAVSDK, a controller.
"""

from __future__ import annotations

import getpass
import sys
from pathlib import Path

from robotree.protocol.links.keyring import Keyring, create, names
from robotree.protocol.links.url import SCHEMES
from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.processes.realm import chosen
from robotree.tui.terminal import answer
from robotree.tui.wire.security import key_file

ALL = "*"


def key(line: Line, _realm: str) -> int:
    """Make the file, and print the fingerprint of its key; or print a controller's key."""
    if line.text("--of"):
        return show(line, line.text("--of"))
    path, pattern = Path(line.text("FILE")), line.text("--links", ALL)
    create(path, pattern, passphrase() if line.flag("--passphrase") else None)
    ((links, key),) = Keyring(path).keys
    text = f"{path}: a key for links {links}, fingerprint {key.fingerprint}; keep the file to yourself"
    answer(text, lambda: {"file": str(path), "links": links, "fingerprint": key.fingerprint})
    return exit_codes.DONE


def show(line: Line, controller: str) -> int:
    """Print what a program needs to command one controller."""
    file = key_file(line.text("FILE"), chosen(line.text("--realm")))
    if file is None:
        raise ValueRefused("FILE", "there is no key in `none`; name a key file, or `realm`")
    if controller.partition(":")[0] in SCHEMES:
        controller = (names(controller) or [controller])[0]
    facts = {"controller": controller, **Keyring(file).told(controller)}
    answer("\n".join(f"{name:<11} {value}" for name, value in facts.items()), lambda: facts)
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
