"""The full screen for as long as the operator wants it: opened anew after an error, warnings in a file.

How the interpreter runs while a screen answers keys: threads take turns often, collections are short.

Textual writes to the terminal in a thread of its own. Where two threads want to run, CPython changes between
them every 5 ms, so that the event loop may wait that long for the writer. With 1,000 robots, shorter turns
took the 95th percentile from a key to its first byte from 12.7 to 6.9 ms (docs/performance.md). A full
garbage collection looks at every object of the program, most of which are modules that never go: 25 to 43 ms.
"""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from functools import partial
from logging.handlers import RotatingFileHandler
from typing import TYPE_CHECKING

from robotree.tui import exit_codes
from robotree.tui.processes.choices import LOOKS, STEPS, Choices
from robotree.tui.processes.layout import layout_file
from robotree.tui.processes.state_files import state_file
from robotree.tui.processes.terminal_graphics import pictures_here
from robotree.tui.screen import keymap, themes
from robotree.tui.screen.app import Supervisor
from robotree.tui.seen.store import Store
from robotree.tui.terminal import complain

if TYPE_CHECKING:
    from robotree.vr.supervision.realm_client import RealmClient

CALM = "ROBOTREE_CALM"
"""In the environment: unless it is empty or 0, the line to the terminal is slow (`robotree --calm`)."""

LOG_FILE = "supervisor.log"
"""In `$XDG_STATE_HOME/robotree/REALM`."""
LOG_SIZE = 1_000_000
"""Bytes, after which the log begins anew; the one before is kept."""

CRASHES = 3
"""Screens that may end by an error within `CRASH_WINDOW`, before the supervisor ends."""
CRASH_WINDOW = 30.0
"""[s]"""


@contextmanager
def _logging_to_a_file(realm: str) -> Generator[None]:
    """Write warnings to a file meanwhile: the terminal belongs to the screen."""
    path = state_file(realm, LOG_FILE)
    handler: logging.Handler = logging.NullHandler()
    if path is not None:
        handler = RotatingFileHandler(path, maxBytes=LOG_SIZE, backupCount=1, delay=True, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    logging.getLogger().addHandler(handler)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(handler)
        handler.close()


async def supervise(
    realm_client: RealmClient,
    realm: str,
    *,
    farewell: str = "",
    hint: str = "",
    readonly: bool = False,
    store: Store | None = None,
    screen: Callable[..., Supervisor] = Supervisor,
) -> int:
    """Show the full screen until the operator leaves; open it anew should an error end it.

    Args:
        realm_client: the agents of the realm.
        realm: its name, to be shown.
        farewell: what ends with the screen; empty: nothing does.
        hint: what a person can do next, as the first line of the log; empty: none.
        readonly: whether all that changes robots is absent.
        store: what the screen shows; None: a new one.
        screen: makes the screen.

    Returns:
        The exit code.

    Raises:
        BadKeymap: the operator's file of keys is wrong.
        BadTheme: a file of colours is.
    """
    with _logging_to_a_file(realm), prompt_answers():
        store = store or Store()
        if hint:
            store.tell(hint, "good", time.monotonic())
        make = partial(screen, realm_client, realm=realm, farewell=farewell, readonly=readonly)
        return await _show(make, realm, store)


async def _show(make: Callable[..., Supervisor], realm: str, store: Store) -> int:
    keys, steps, layout = keymap.load(), Choices(state_file(realm, STEPS)), layout_file()
    own, looks = themes.load(), Choices(state_file(realm, LOOKS))
    calm = os.environ.get(CALM, "") not in {"", "0"}
    task, ends = asyncio.current_task(), list[float]()
    while True:
        app = make(store=store, keymap=keys, calm=calm, steps=steps, layout=layout)
        app.looks.wear(looks, own)
        if not app.is_web:
            app.pictures = pictures_here()
        code = await app.run_async()
        if task is not None and task.cancelling():  # Textual ends at a cancel as at a key, and says nothing
            raise asyncio.CancelledError
        if app.fatal is None:
            return code or exit_codes.DONE
        now = time.monotonic()
        ends = [end for end in ends if now - end < CRASH_WINDOW] + [now]
        if len(ends) >= CRASHES:
            complain(
                f"the screen ended {CRASHES} times by {app.fatal!r}; the robots go on; use the command line"
            )
            return exit_codes.REFUSED
        store.tell(f"the screen had to be opened anew: {app.fatal!r}", "error", now)


TURN = 0.0005
"""[s] after which a thread gives way to another that wants to run."""

SETTLED = 3.0
"""[s] after which what a screen needs has been imported and made."""


def _settle() -> None:
    """Keep what is there now out of every later garbage collection."""
    gc.collect()
    gc.freeze()


@contextmanager
def prompt_answers() -> Generator[None]:
    """Run the interpreter so that the event loop of this thread answers quickly; as it was, afterwards."""
    before = sys.getswitchinterval()
    settling = asyncio.get_running_loop().call_later(SETTLED, _settle)
    sys.setswitchinterval(TURN)
    try:
        yield
    finally:
        settling.cancel()
        gc.unfreeze()
        sys.setswitchinterval(before)
