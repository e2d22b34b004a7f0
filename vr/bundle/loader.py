"""Runs an author's source as a private module, with a limit of time.

Nobody's import path is touched: each robot gets a module of its own, under a name that no other has, so that
what two robots of one page keep in their classes is not shared. It lives as long as its robot.

What lies beside a page is a private package: the page is the package itself, so that `from . import helper`
and `from .lib.grip import close` are Python's own. An absolute import (`import helper`) is led to the package
by an `__import__` that only the modules of this package have. Their files lie in a folder of their own as
long as the robot lives, so that `Path(__file__).with_name("map.json")` finds them.
"""

from __future__ import annotations

import atexit
import builtins
import contextvars
import dataclasses
import hashlib
import importlib.abc
import importlib.machinery
import importlib.util
import inspect
import itertools
import linecache
import logging
import math
import shutil
import sys
import tempfile
import threading
import traceback
import weakref
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent import futures
from functools import lru_cache
from pathlib import Path, PurePosixPath
from types import CodeType, ModuleType
from typing import Any, TypeVar, cast

from robotree.files import overwrite
from robotree.vr.author.child import Slotted
from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import RESERVED, Service, VirtualRobot, slot_specs
from robotree.vr.base.errors import (
    PRIVATE_FOLDER,
    PRIVATE_MODULE,
    BadName,
    BrokenScript,
    BrokenSource,
    RequirementUnreadable,
    words_of,
)
from robotree.vr.base.extras import lack_of
from robotree.vr.bundle.refused import mistakes
from robotree.vr.bundle.syntax import TOO_DEEP, line_of, slots_at
from robotree.vr.running.page_trace import authors_file, file_in_tracebacks
from robotree.vr.running.runner import Interrupted, InterruptibleThread

LIMIT = 5.0
"""[s] for a source to run."""
_INTERRUPTED_WITHIN = 1.0
"""[s] for what was interrupted to end, so that the error can name its line."""

_T = TypeVar("_T")
_Robot = TypeVar("_Robot", bound=Robot)
_numbers = itertools.count(1)
_pages: dict[str, tuple[str, str]] = {}
"""Path and hash of the page of each loaded module, by the module's name."""
_texts: Counter[str] = Counter()
"""How many loaded modules were made of each text, by the name that it has in tracebacks."""
_lock = threading.Lock()
_log = logging.getLogger(__name__)
_READ_BY = f"(this host runs Python {sys.version_info[0]}.{sys.version_info[1]})"
"""The note on a syntax error: a newer Python may know what is written."""
_OURS = Path(__file__).resolve().parents[1]
"""Folder of the agents' code."""


def load_module(
    source: str, path: str, digest: str, *, files: Mapping[str, bytes] | None = None, limit: float = LIMIT
) -> ModuleType:
    """Return a new module of a source.

    Args:
        source: Python.
        path: where its author keeps it.
        digest: hash of the source.
        files: beside it, by their path from its folder.
        limit: [s] for it to run.

    Returns:
        The module, registered like any other until `forget`, or for as long as `keep_with` says.

    Raises:
        BrokenSource: it does not compile, raises or does not end.
    """
    file = file_in_tracebacks(path, digest)
    code = _compile(source, path, file)
    module = ModuleType(f"{PRIVATE_MODULE}{digest[:16]}_{next(_numbers)}")
    module.__file__ = file
    sys.modules[module.__name__] = module  # where dataclasses and type hints look for it
    with _lock:
        _pages[module.__name__] = (path, digest)
        _texts[file] += 1
        linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    try:
        if files:
            Package(module, path, files)
        within(lambda: exec(code, vars(module)), path, file, limit)  # noqa: S102 # the one place that does so
    except BaseException:
        forget(module.__name__)
        raise
    return module


def text_of(cls: type[Any]) -> str:
    """Return what the page of a class is called in tracebacks."""
    return file_in_tracebacks(*_pages[cls.__module__])


def keep_with(robot: VirtualRobot) -> None:
    """Let the module of a robot's class end with the robot."""
    weakref.finalize(robot, forget, type(robot).__module__).atexit = False


def forget(name: str) -> None:
    """Remove a module and what lies beside it, and its text when no other module is made of it."""
    sys.modules.pop(name, None)
    file = file_in_tracebacks(*_pages.pop(name))
    if package := _packages.get(name):
        package.close()
    with _lock:
        _texts[file] -= 1
        if not _texts[file]:
            del _texts[file]
            linecache.cache.pop(file, None)


def built(cls: type[VirtualRobot], name: str, given: Mapping[str, Any]) -> VirtualRobot:
    """Return a new robot with the given settings, which are checked; its constructor can read them already.

    Raises:
        BadName: that cannot be a name.
        TypeError: the constructor does not take a name, or makes a child.
    """
    expect_constructor(cls)
    robot = cls.__new__(cls)
    robot.field_values.give(given)
    robot.__init__(name)  # type: ignore[misc] # with its settings in place
    for attribute, value in vars(robot).items():
        if isinstance(value, Slotted):
            reason = f"{cls.__name__}.__init__ sets self.{attribute} to a Child, which makes no slot"
            slot = f"{attribute} = {type(value).__name__}({value.kind!r})"
            raise TypeError(f"{reason}; write {slot} in the class")
    if hasattr(robot, "name"):
        robot.field_values.give(given)  # what is asked for comes before what a constructor sets
    return robot


def _expect_requirements(cls: type[VirtualRobot]) -> None:
    """Refuse a slot whose `where` cannot be read, and a service's role.

    Raises:
        TypeError: says what is wrong with it.
    """
    for spec in slot_specs(cls):
        if spec.where:
            from robotree.vr.scripts.requirement import requirement  # most pages choose nobody

            try:
                requirement(spec.where)
            except RequirementUnreadable as error:
                raise TypeError(f"{cls.__name__}.{spec.name}: {error}") from None
    if issubclass(cls, Service) and cls.lends:
        from robotree.vr.scripts.roles.profile import lent_by  # most pages lend none

        try:
            lent_by(cls.__name__, cls.lends)
        except BrokenScript as error:
            raise TypeError(f"{cls.__name__}.lends: {error}") from None


def expect_constructor(cls: type[VirtualRobot]) -> None:
    """Refuse a constructor that does not take the name alone, and what hides something of each robot.

    Raises:
        TypeError: says what to write instead.
    """
    kind = cls.__name__
    for name in sorted(RESERVED):
        if inspect.getattr_static(cls, name, None) is not inspect.getattr_static(VirtualRobot, name, None):
            raise TypeError(f"{kind}.{name}: it cannot have this name; every robot uses it itself")
    if dataclasses.is_dataclass(cls):
        instead = "take @dataclass away; settings are attributes with a type and a default"
        raise TypeError(f"{kind}.__init__ is that of a dataclass: {instead}")
    _expect_requirements(cls)
    if cls.__init__ is VirtualRobot.__init__:
        return
    try:
        inspect.signature(cls).bind("name")
    except TypeError:
        raise TypeError(
            f"{kind}.__init__ must take the robot's name and nothing else: "
            "write def __init__(self, name: str) and super().__init__(name); what people choose is a setting"
        ) from None


def make(
    cls: type[_Robot],
    build: Callable[[], _Robot],
    name: str,
    path: str,
    *,
    takes: str = "name",
    limit: float = LIMIT,
) -> _Robot:
    """Return a new robot of a loaded class, which `build` makes within `limit` [s].

    For messages, `takes` is what a constructor of this kind must hand on to its base.

    Raises:
        BadName: that cannot be a name.
        BrokenSource: the constructor raises or does not end, or does not call its base's.
    """
    robot = within(build, path, text_of(cls), limit)
    unmade = isinstance(robot, VirtualRobot) and not hasattr(robot, "slots_now")
    if getattr(robot, "name", None) != name or unmade:
        reason = f"{cls.__name__}.__init__ must call super().__init__({takes})"
        raise BrokenSource(path=path, reason=reason)
    return robot


def within(work: Callable[[], _T], path: str, file: str, limit: float) -> _T:
    """Run an author's code in a thread of its own, which can be interrupted, and return what it returns.

    Args:
        work: the code.
        path: of its source.
        file: its name in tracebacks.
        limit: [s] for it to end; infinite: it runs in this thread.

    Raises:
        BadName: it refused the name it was given.
        BrokenSource: it raised anything else, or did not end.
    """
    outcome: futures.Future[tuple[Any, BaseException | None]] = futures.Future()
    context = contextvars.copy_context()  # who takes what it says
    thread = InterruptibleThread(
        lambda: context.run(work),
        lambda value, error: outcome.set_result((value, error)),
        name=f"load {path}",
    )
    if limit == math.inf:
        thread.run()
    else:
        thread.start()
    if not futures.wait([outcome], limit).done:
        thread.interrupt()
        futures.wait([outcome], _INTERRUPTED_WITHIN)
    if not outcome.done():
        reason = f"it did not end within {limit:g} s, ignores every interruption and still runs"
        _log.error("%s is abandoned while being loaded: %s; restart this host", path, reason)
        raise BrokenSource(path=path, reason=f"{reason}; restart the host")
    value, error = outcome.result()
    if error is None:
        return cast("_T", value)
    if isinstance(error, BadName):
        raise error
    raise BrokenSource(path=path, reason=reason_of(error, file, limit))


@lru_cache(32)
def _compile(source: str, path: str, file: str) -> CodeType:
    try:
        code = compile(source, file, "exec", dont_inherit=True)
        refused = mistakes(source)
    except SyntaxError as error:
        where = f"line {error.lineno}: " if error.lineno else ""
        raise BrokenSource(path=path, reason=f"{where}{error.msg} {_READ_BY}") from None
    except (RecursionError, MemoryError):
        raise BrokenSource(path=path, reason=TOO_DEEP) from None
    except (ValueError, OverflowError) as error:
        raise BrokenSource(path=path, reason=str(error) or type(error).__name__) from None
    for one in refused[:1]:
        raise BrokenSource(path=path, reason=f"line {one.line}: {one.what}; {one.instead}")
    return code


def reason_of(error: BaseException, file: str, limit: float = LIMIT) -> str:
    """Return why a page cannot be loaded, behind its line.

    Args:
        error: that its code ended with.
        file: its name in tracebacks.
        limit: [s] that its code had.
    """
    frames = traceback.extract_tb(error.__traceback__)
    where = next((_place(frame, file) for frame in reversed(frames) if _of_author(frame.filename, file)), "")
    if isinstance(error, SyntaxError) and error.filename and _of_author(error.filename, file):
        return f"{Path(authors_file(error.filename)).name}, line {error.lineno}: {error.msg} {_READ_BY}"
    if isinstance(error, Interrupted):
        return f"{where}it did not end within {limit:g} s"
    if isinstance(error, ImportError) and (lack := lack_of(error)):
        return f"{where}on this host {lack}"
    ours = bool(frames) and Path(frames[-1].filename).is_relative_to(_OURS)
    if ours and isinstance(error, TypeError | ValueError):  # one of our own sentences
        line = line_of("".join(linecache.getlines(file)), str(error))
        return f"{f'line {line}: ' if line else where}{error}"
    return f"{where}{_no_slot(error, file) or words_of(error)}"


def _no_slot(error: BaseException, file: str) -> str:
    """Say which slots there are, where a page exposes a command of one that there is not; else nothing."""
    last = traceback.extract_tb(error.__traceback__)[-1:]
    if not isinstance(error, NameError) or not last or last[0].filename != file:
        return ""
    if f"{error.name}.exposed(" not in (last[0].line or ""):
        return ""
    slots = slots_at("".join(linecache.getlines(file)), last[0].lineno or 0)
    sentence = f"the slots above it are: {', '.join(slots)}" if slots else "there is none above it"
    return f"no slot {error.name!r}; {sentence}"


def _of_author(filename: str, file: str) -> bool:
    """Whether a file, as tracebacks call it, is the page or lies beside it."""
    parent = Path(authors_file(file)).parent
    known = authors_file(filename)
    return filename == file or (known != filename and Path(known).is_relative_to(parent))


def _place(frame: traceback.FrameSummary, file: str) -> str:
    name = "" if frame.filename == file else f"{Path(authors_file(frame.filename)).name}, "
    return f"{name}line {frame.lineno}: "


# -- modules and data beside a page ----------------------------------------------------------------

_packages: dict[str, Package] = {}
"""By the name of the page's module."""


class Package:
    """The files of one robot's page."""

    def __init__(self, module: ModuleType, path: str, files: Mapping[str, bytes]) -> None:
        """Lay the files into a folder, and make the page's module a package.

        Args:
            module: of the page, not yet run.
            path: of the page, as its author knows it.
            files: beside it, by their path from its folder.

        Raises:
            BrokenSource: a file's path leads elsewhere.
        """
        self.name, self.path, self.files = module.__name__, path, files
        self.folder = Path(tempfile.mkdtemp(prefix=PRIVATE_FOLDER))
        self.sources: dict[str, str] = {}
        """Name in tracebacks of each module that was loaded, and its path from the page's folder."""
        _packages[self.name] = self
        for file, data in files.items():
            self._lay(file, data)
        self._tops = {
            PurePosixPath(file).parts[0].removesuffix(".py") for file in files if file.endswith(".py")
        }
        self._stem = Path(path).stem
        module.__file__ = str(self.folder / Path(path).name)
        module.__path__ = [str(self.folder)]
        module.__package__ = self.name
        vars(module)["__builtins__"] = self._builtins = {**vars(builtins), "__import__": self._import}

    def _lay(self, file: str, data: bytes) -> None:
        place = PurePosixPath(file)
        if place.is_absolute() or ".." in place.parts or not place.parts:
            raise BrokenSource(path=self.path, reason=f"the file {file!r} does not lie beside it")
        target = self.folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        overwrite(target, data)

    def close(self) -> None:
        """Forget the modules and remove the files."""
        _packages.pop(self.name, None)
        for name in [name for name in sys.modules if name.startswith(f"{self.name}.")]:
            sys.modules.pop(name, None)
        for source in self.sources:
            linecache.cache.pop(source, None)
        shutil.rmtree(self.folder, ignore_errors=True)

    def find(self, fullname: str) -> importlib.machinery.ModuleSpec | None:
        """Return how a module of the package is loaded; None: there is none of this name."""
        place = PurePosixPath(*fullname.split(".")[1:])
        file = next((one for one in (f"{place}/__init__.py", f"{place}.py") if one in self.files), "")
        is_package = file != f"{place}.py"
        if not file and not any(one.startswith(f"{place}/") and one.endswith(".py") for one in self.files):
            return None
        loader, origin = (_Loader(self, file), str(self.folder / file)) if file else (None, None)
        spec = importlib.machinery.ModuleSpec(fullname, loader, origin=origin, is_package=is_package)
        if is_package:
            spec.submodule_search_locations = [str(self.folder / place)]
        return spec

    def run(self, module: ModuleType, file: str) -> None:
        """Run one of the modules."""
        data = self.files[file]
        digest = hashlib.sha256(data).hexdigest()
        source = file_in_tracebacks(str(Path(self.path).parent / file), digest)
        text = importlib.util.decode_source(data)
        self.sources[source] = file
        linecache.cache[source] = (len(text), None, text.splitlines(keepends=True), source)
        module.__file__ = str(self.folder / file)
        vars(module)["__builtins__"] = self._builtins
        exec(compile(data, source, "exec", dont_inherit=True), vars(module))  # noqa: S102 # as for the page

    def _import(
        self,
        name: str,
        globals: Mapping[str, Any] | None = None,  # noqa: A002 # Python's own names
        locals: Mapping[str, Any] | None = None,  # noqa: A002 # as above
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        """Do what an import statement of a module of this package means."""
        top, _, rest = name.partition(".")
        if level or top not in {*self._tops, self._stem}:
            return builtins.__import__(name, globals, locals, fromlist or (), level)
        if top == self._stem and top not in self._tops:
            return sys.modules[self.name]
        found = builtins.__import__(f"{self.name}.{name}", globals, locals, fromlist or ("__name__",), 0)
        return found if fromlist or not rest else sys.modules[f"{self.name}.{top}"]


class _Loader(importlib.abc.Loader):
    def __init__(self, package: Package, file: str) -> None:
        self._package, self._file = package, file

    def exec_module(self, module: ModuleType) -> None:
        """Run the module."""
        self._package.run(module, self._file)


class _Finder(importlib.abc.MetaPathFinder):
    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find a module of a private package."""
        del path, target
        if not fullname.startswith(PRIVATE_MODULE):
            return None
        package = _packages.get(fullname.partition(".")[0])
        return None if package is None else package.find(fullname)


sys.meta_path.insert(0, _Finder())


@atexit.register
def close_all() -> None:
    """Remove the files of all packages: the process ends."""
    for package in list(_packages.values()):
        package.close()
