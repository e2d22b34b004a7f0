"""Runs an author's source once, as a private module, with a limit of time.

Nobody's import path is touched: the module is made here and named after the hash of its source, so two
versions of one file live side by side, and the same version is loaded once.
"""

from __future__ import annotations

import linecache
import sys
import threading
import traceback
from collections.abc import Callable
from types import CodeType, ModuleType
from typing import Any, TypeVar, cast

from robotree.vr.errors import BadName, BrokenSource
from robotree.vr.host.interruptible import Interrupted, InterruptibleThread
from robotree.vr.virtual_robot import VirtualRobot

LIMIT = 5.0
"""[s] for a source to run."""
_FAREWELL = 1.0
"""[s] for what was interrupted to say where."""

_T = TypeVar("_T")
_loading: dict[str, threading.Lock] = {}


def load_module(source: str, path: str, digest: str, *, limit: float = LIMIT) -> ModuleType:
    """Return the module of a source.

    Args:
        source: Python.
        path: where its author keeps it.
        digest: hash of the source.
        limit: [s] for it to run.

    Raises:
        BrokenSource: it does not compile, raises or does not end.
    """
    name = f"robotree_bundle_{digest[:16]}"
    code = _compile(source, path)
    with _loading.setdefault(name, threading.Lock()):
        if name in sys.modules:
            return sys.modules[name]
        module = sys.modules[name] = ModuleType(name)  # where dataclasses and type hints look for it
        module.__file__ = path
        linecache.cache[path] = (len(source), None, source.splitlines(keepends=True), path)
        try:
            within(lambda: exec(code, vars(module)), path, limit)  # noqa: S102 # the one place that does so
        except BaseException:
            del sys.modules[name]
            raise
        return module


def make(cls: type[VirtualRobot], name: str, path: str, *, limit: float = LIMIT) -> VirtualRobot:
    """Return a new robot of a loaded class.

    Args:
        cls: the class.
        name: of the robot.
        path: of the source.
        limit: [s] for the constructor.

    Raises:
        BadName: that cannot be a name.
        BrokenSource: the constructor raises or does not end.
    """
    robot = within(lambda: cls(name), path, limit)
    if getattr(robot, "name", None) != name or not hasattr(robot, "child_slots"):
        raise BrokenSource(path=path, reason=f"{cls.__name__}.__init__ must call super().__init__(name)")
    return robot


def within(work: Callable[[], _T], path: str, limit: float) -> _T:
    """Run an author's code in a thread of its own and return what it returns.

    Args:
        work: the code.
        path: of its source.
        limit: [s] for it to end.

    Raises:
        BadName: it refused the name it was given.
        BrokenSource: it raised anything else, or did not end.
    """
    outcome: list[tuple[Any, BaseException | None]] = []
    ended = threading.Event()

    def done(value: object, error: BaseException | None) -> None:
        outcome.append((value, error))
        ended.set()

    thread = InterruptibleThread(work, done, name=f"load {path}")
    thread.start()
    if not ended.wait(limit):
        thread.interrupt()
        ended.wait(_FAREWELL)
    value, error = outcome[0] if outcome else (None, Interrupted())
    if error is None:
        return cast("_T", value)
    if isinstance(error, BadName):
        raise error
    raise BrokenSource(path=path, reason=_reason(error, path, limit))


def _compile(source: str, path: str) -> CodeType:
    try:
        return compile(source, path, "exec", dont_inherit=True)
    except SyntaxError as error:
        where = f"line {error.lineno}: " if error.lineno else ""
        raise BrokenSource(path=path, reason=f"{where}{error.msg}") from None
    except (ValueError, RecursionError, MemoryError, OverflowError) as error:
        raise BrokenSource(path=path, reason=str(error) or type(error).__name__) from None


def _reason(error: BaseException, path: str, limit: float) -> str:
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    where = f"line {lines[-1]}: " if lines else ""
    if isinstance(error, Interrupted):
        return f"{where}it did not end within {limit:g} s"
    return f"{where}{type(error).__name__}: {error}".removesuffix(": ")
