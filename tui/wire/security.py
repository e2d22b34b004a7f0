"""The keys of the links that a command opens: `--key FILE`, or `$ROBOTREE_KEY`; `--open`: none.

The file is one that `robotree wire key FILE` makes, or `realm`: the realm's own, made without a question for
processes that one command starts together. Its path is all that command lines, logs and errors show.

`robotree wire key FILE --of CONTROLLER` prints the key of one controller, for programs that have no such
file: MAVProxy, QGroundControl, MAVSDK, a controller.
"""

from __future__ import annotations

import fcntl
import getpass
import hashlib
import os
import secrets
import sys
import time
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

from robotree.files import private_folder
from robotree.protocol.errors import KeyFileError
from robotree.protocol.links.heard import HeardFile
from robotree.protocol.links.keyring import Keyring, create, names
from robotree.protocol.links.security import UNSIGNED, LinkSecurity, Security, persisting
from robotree.protocol.links.url import SCHEMES
from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.processes.realm import chosen, folder_of
from robotree.tui.terminal import answer
from robotree.vr.network.realms import common_folder, places

VARIABLE = "ROBOTREE_KEY"
NOTHING = "none"
"""The word instead of a file for links without keys, although the variable is set."""
REALM = "realm"
"""The word instead of a file for the realm's own key."""
REALM_KEY = "realm.key"
"""The name of its file, in the realm's folder."""
KEY_WITHIN, LOOK = 2.0, 0.01
"""[s] to wait for another process that makes the realm's key, and between two looks."""


def wanted(line: Line, otherwise: str = NOTHING) -> str:
    """Return what a line, or else the environment, says of keys: a file, `realm` or `none`.

    Args:
        line: with `--key` or `--open`, or neither.
        otherwise: what is meant when nothing is said.
    """
    return NOTHING if line.flag("--open") else line.text("--key") or os.environ.get(VARIABLE) or otherwise


def key_file(given: str, realm: str) -> Path | None:
    """Return the file that is meant by a file, `realm` or `none`; None: links are open.

    Raises:
        RealmUnusable: the realm's folder cannot be used.
        KeyFileError: its key cannot be made.
    """
    if given == NOTHING:
        return None
    return realm_key(realm) if given == REALM else Path(given)


def examined(path: Path) -> str:
    """Say why a key file cannot be used; empty: it can."""
    try:
        return "" if Keyring(path).keys else f"{path} holds no key"
    except KeyFileError as error:
        return str(error)


def realm_key(realm: str) -> Path:
    """Return the file with a realm's key; who comes first makes it, for all who come later.

    Of a realm that lies in two folders (`realms.places`) it is the same file for all.

    Raises:
        RealmUnusable: the realm's folder cannot be used.
        KeyFileError: the file cannot be made.
    """
    folder = folder_of(realm)
    made = _made_key(folder)
    if made is None:
        with _alone(common_folder(folder)):
            made = _made_key(folder) or _make_key(folder)
    return made


def _made_key(folder: Path) -> Path | None:
    """Return the realm's key, in whichever of its folders it is; None: nobody has made one."""
    keys = (place / REALM_KEY for place in sorted(places(folder)))
    return next((key for key in keys if key.exists()), None)


@contextmanager
def _alone(folder: Path) -> Generator[None]:
    """Let one process after another make a key: two in two folders of a realm would make two.

    A process that is stopped meanwhile holds others up for `KEY_WITHIN`. Where the folder cannot be private
    nobody waits: no process of ours uses it.
    """
    until = time.monotonic() + KEY_WITHIN
    try:
        private_folder(folder, strict=True)
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        yield
        return
    try:
        while time.monotonic() < until:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                time.sleep(LOOK)
        yield
    finally:
        os.close(lock)


def _make_key(folder: Path) -> Path:
    path, draft = folder / REALM_KEY, folder / f".{secrets.token_hex(8)}.key"
    create(draft)
    try:
        os.link(draft, path)  # at once, so that nobody finds half of it
    except FileExistsError:
        pass  # somebody else was quicker
    except OSError:  # a file system without hard links: of those who come at one moment the last one wins
        try:
            draft.replace(path)
        except OSError as error:
            raise KeyFileError(path, f"cannot be made: {error.strerror}") from error
    finally:
        draft.unlink(missing_ok=True)
    return path


def openness(url: str) -> str:
    """Say who may command a controller that listens at an address without a key."""
    scheme = url.partition(":")[0]
    who = {"serial": "whatever is at the other end of the line", "can": "everything on its bus"}
    anybody = who.get(scheme, "every user and program of this machine")
    return f"this controller has no key: {anybody} may command it; --key FILE asks for one (docs/security.md)"


@asynccontextmanager
async def securing(line: Line) -> AsyncGenerator[LinkSecurity]:
    """Read the keys for what a line starts, and keep their time inside the block.

    With a file everything that is opened is signed: an address that the file has no key for is refused.

    Yields:
        What signs the links; without a file, nothing does.

    Raises:
        KeyFileError: the file cannot be used, or has no key for an address of the line.
        BadUrl: an address means nothing.
    """
    file = key_file(wanted(line), chosen(line.text("--realm")))
    if file is None:
        yield UNSIGNED
        return
    keys = Keyring(file)
    for option in ("--listen", "--connect"):
        if line.text(option):
            keys.require(line.text(option), listening=option == "--listen")
    for address in line.many("URL"):
        keys.require(address, listening=False)
    link = secrets.randbelow(256)
    with remembering(file, line.text("--listen")) as heard:
        async with persisting(Security(keys, time.time, first_link=link, heard=heard)) as security:
            yield security


@contextmanager
def remembering(file: Path, listens: str) -> Generator[HeardFile | None]:
    """Open what the controller at an address remembers of the times that it has heard, beside its key file.

    Yields:
        The file; None: nothing listens, or at a port that is free by chance: the next one there is another.

    Raises:
        KeyFileError: it cannot be used.
    """
    found = names(listens) if listens else []
    if len(found) != 1:
        yield None
        return
    real, mark = file.resolve(), hashlib.sha256(found[0].encode()).hexdigest()[:12]
    heard = HeardFile(real.with_name(f"{real.name}.{mark}.heard"))
    try:
        yield heard
    finally:
        heard.close()


# -- `robotree wire key` ---------------------------------------------------------------------------

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
