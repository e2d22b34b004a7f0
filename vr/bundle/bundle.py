"""One file of an author's source on its way to a host: read here, named by its hash, loaded there."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self, TypeVar

import msgspec

from robotree.files import text
from robotree.vr.author.command import commands_of
from robotree.vr.author.fields import Kept, settings_spec
from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import VirtualRobot, exposures_of, slot_specs
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import CommandSpec
from robotree.vr.base.errors import (
    BadBundle,
    BrokenSource,
    NoSuchFile,
    NoVirtualRobot,
    OtherKind,
    SeveralVirtualRobots,
    VrError,
)
from robotree.vr.base.extras import lack_of
from robotree.vr.base.permissions import SignedManifest
from robotree.vr.base.plain import to_plain
from robotree.vr.base.requests import Create
from robotree.vr.bundle.beside import LARGEST as LARGEST_BESIDE
from robotree.vr.bundle.beside import beside
from robotree.vr.bundle.loader import (
    LIMIT,
    built,
    expect_constructor,
    forget,
    keep_with,
    load_module,
    make,
    reason_of,
    text_of,
    within,
)
from robotree.vr.bundle.manifest import PANEL
from robotree.vr.bundle.syntax import parse

if TYPE_CHECKING:
    from robotree.vr.bundle.file import BundleFile
    from robotree.vr.journal.records import KeptPage

LARGEST = 1_000_000
"""[bytes] More is no page of Python."""
THAWING = 0.2
"""[s] for a `thaw`: the robot does nothing else meanwhile."""
SUFFIX = ".bundle"
"""End of the name of a bundle's file."""
_R = TypeVar("_R", bound=Robot)


class Bundle(msgspec.Struct, frozen=True):
    """The source of a virtual robot's class."""

    source: str
    path: str
    """Where its author keeps it; for messages, never opened by a host."""
    wanted: str = ""
    """Name of the class; empty: the only virtual robot in the source."""
    files: dict[str, bytes] = {}
    """Modules and data that belong to it, by their path from its folder: see `beside.py`."""
    signed: SignedManifest | None = None
    """What its signer says of it; None: nobody has signed it."""
    sender: str = ""
    """Who has sent it unsigned, if that is not this user; a host runs it only where that was asked for."""

    @classmethod
    def read(cls, path: str | Path, wanted: str = "") -> Self:
        """Read a bundle from a file; `wanted` is the name of the class, empty: the only one.

        Raises:
            NoSuchFile: it cannot be read, is no ordinary file, is too large, or is no text.
            BrokenSource: what lies beside it and belongs to it cannot be used; or it is of another kind.
            BadBundle: it is a bundle that breaks a rule.
        """
        try:
            file = Path(path).expanduser()
            if file.suffix == SUFFIX:
                from robotree.vr.bundle.file import BundleFile  # an own page needs none of it

                return cls.of_file(BundleFile.read(file), str(path), wanted)
            source = text(file, LARGEST)
            if not (is_script(str(path)) or file.suffix.lower() == ".py"):
                _expect_python(source, str(path))
            files = {} if is_script(str(path)) else beside(file, source)
            return cls(source, str(path), wanted, files)
        except (OSError, RuntimeError) as error:  # RuntimeError: nobody has the home that ~NAME means
            reason = getattr(error, "strerror", None) or str(error)
            raise NoSuchFile(path=str(path), reason=reason) from None

    @classmethod
    def of_file(cls, found: BundleFile, path: str, wanted: str = "") -> Self:
        """Return the page of a bundle.

        Args:
            found: the bundle.
            path: of its file.
            wanted: name of the class; empty: the one of the manifest.

        Raises:
            BadBundle: the manifest cannot be used, is for another class, or the page is no text.
        """
        manifest, files = found.manifest(path), dict(found.files)
        if wanted not in ("", manifest.wanted):
            raise BadBundle(
                path=path, reason=f"its manifest is for the class {manifest.wanted or 'it has'!r}"
            )
        try:
            source = files.pop(manifest.page).decode()
        except UnicodeDecodeError:
            raise BadBundle(path=path, reason=f"{manifest.page} is no text") from None
        return cls(source, f"{path}/{manifest.page}", manifest.wanted, files, found.signed)

    @property
    def origin(self) -> str:
        """Where a reload finds it again on the author's machine: the file, and `:Class` if that was named."""
        file = str(Path(self.path).expanduser().absolute())
        if self.signed is not None:
            file, _, _ = file.rpartition("/")
            return file
        return f"{file}:{self.wanted}" if self.wanted else file

    @property
    def hash(self) -> str:
        """SHA-256 of the source, of what belongs to it, and of its manifest, in hex: its version."""
        version = hashlib.sha256(self.source.encode())
        for name, data in sorted(self.files.items()):
            version.update(name.encode() + b"\0" + hashlib.sha256(data).digest())
        if self.signed is not None:  # it says what the page may do, and who has signed that
            version.update(b"\0" + self.signed.manifest)
        return version.hexdigest()

    def load(self, *, limit: float = LIMIT) -> type[VirtualRobot]:
        """Load the class anew, in a module of its own. Blocks: not for an event loop.

        Args:
            limit: [s] for the source to run.

        Returns:
            The class. Its module stays in the process; that of a robot made by `create` goes with the robot.

        Raises:
            BrokenSource: it is too large, does not compile, raises, does not end, or declares its robot
                wrongly.
            NoVirtualRobot: there is none, or none of the name wanted.
            SeveralVirtualRobots: there are several, and none was named.
        """
        size = sum(map(len, self.files.values()))
        if len(self.source) > LARGEST or len(self.source.encode()) > LARGEST or size > LARGEST_BESIDE:
            raise BrokenSource(path=self.path, reason=f"it is larger than {LARGEST // 1000} kB")
        if is_script(self.path):
            return self._script()
        return self.load_class(VirtualRobot, NoVirtualRobot, SeveralVirtualRobots, limit=limit)

    def load_class(
        self, base: type[_R], none: type[VrError], several: type[VrError], *, limit: float = LIMIT
    ) -> type[_R]:
        """Load the one class of a kind that the source defines, in a module of its own. Blocks.

        Args:
            base: from which it derives.
            none: the error if there is none, or none of the name wanted; takes `path` and `wanted`.
            several: the error if there are several, and none was named; takes `path` and `known`.
            limit: [s] for the source to run.

        Raises:
            VrError: one of these two.
            BrokenSource: see `load`.
        """
        files = {name: data for name, data in self.files.items() if not name.endswith(PANEL)}
        module = load_module(self.source, self.path, self.hash, files=files, limit=limit)
        try:
            return self._chosen(module, base, none, several)
        except BaseException:
            forget(module.__name__)
            raise

    def _chosen(
        self, module: ModuleType, base: type[_R], none: type[VrError], several: type[VrError]
    ) -> type[_R]:
        """Return the class of a module that is meant, or refuse how it declares commands and slots."""
        found = {
            name: value
            for name, value in vars(module).items()
            if isinstance(value, type) and issubclass(value, base) and value.__module__ == module.__name__
            if self.wanted in {"", name}
        }
        if not found:
            raise none(path=self.path, wanted=f" named {self.wanted!r}" if self.wanted else "")
        chosen, *others = found.values()
        if others:
            raise several(path=self.path, known=", ".join(found))
        try:
            commands_of(chosen)
            if issubclass(chosen, VirtualRobot):
                slot_specs(chosen)
        except (TypeError, ValueError, AttributeError, LookupError) as error:  # Python 3.14 reads types late
            raise BrokenSource(path=self.path, reason=reason_of(error, text_of(chosen))) from None
        return chosen

    def examine(self) -> tuple[str, tuple[CommandSpec, ...]]:
        """Load the class, and refuse a constructor that no host could call. No robot is made.

        Returns:
            The name of the class, and its commands: those that it exposes without their parameters.

        Raises:
            BundleError: see `load`.
        """
        cls = self.load()
        try:
            within(partial(expect_constructor, cls), self.path, text_of(cls), LIMIT)
            own = tuple(command.spec for command in commands_of(cls).values())
            exposed = (CommandSpec(name=name, available=False) for name in exposures_of(cls))
            return cls.__name__, (*own, *exposed)
        finally:
            forget(cls.__module__)

    def _script(self) -> type[VirtualRobot]:
        """Make the class of a script; CLIPS is loaded by the first one."""
        try:
            from robotree.vr.scripts.script import read_program, script_class
        except ImportError as error:
            if lack := lack_of(error):
                raise BrokenSource(path=self.path, reason=f"on this host {lack}") from None
            raise

        if self.wanted:
            raise BrokenSource(
                path=self.path, reason=f"a script has no classes, so there is no {self.wanted!r}"
            )
        return script_class(read_program(self.source, self.path))

    def again(self, robot: VirtualRobot, *, limit: float = LIMIT) -> VirtualRobot:
        """Load the class and make the same robot of it anew, with the settings and the state that it has.

        Args:
            robot: as it is.
            limit: [s] for the source to run, and again for the constructor.

        Raises:
            OtherKind: the class has another name.
            BundleError: see `load`.
        """
        cls, kind = self.load(limit=limit), type(robot).__name__
        if cls.__name__ != kind:
            raise OtherKind(path=self.path, given=cls.__name__, robot=robot.name, kind=kind)
        kept, _ = Kept(cls).taken_over(robot.field_values.values)
        made = self._make(cls, robot.name, kept, limit)
        before, fields = _version_of(robot), made.field_values
        fields.other_version = before != _version_of(made)
        if type(made).thaw is not VirtualRobot.thaw:
            fields.thaw = partial(_thawed, made, self.path, min(limit, THAWING), before)
        return made

    def request(self, name: str = "", settings: Mapping[str, Any] | None = None, origin: str = "") -> Create:
        """Return it as it stands in a request to make a robot; `origin`: where a reload finds it again."""
        return Create(
            name=name,
            path=self.path,
            source=self.source,
            wanted=self.wanted,
            files=self.files,
            settings=dict(settings or {}),
            signed=self.signed,
            sender=self.sender,
            origin=origin,
        )

    def create(
        self, name: str, *, settings: Mapping[str, Any] | None = None, limit: float = LIMIT
    ) -> VirtualRobot:
        """Load the class and make a virtual robot of it. Blocks, as `load` does.

        Args:
            name: of the robot.
            settings: values that are not the defaults: numbers in the declared units, or text with units.
            limit: [s] for the source to run, and again for the constructor.

        Raises:
            BadName: that cannot be a name.
            BadArgument: a setting cannot have its value, or there is none of this name.
            BundleError: see `load`.
        """
        cls = self.load(limit=limit)
        spec = msgspec.structs.replace(settings_spec(cls), name="create")
        return self._make(cls, name, check_arguments(spec, settings or {}, robot=name), limit)

    def _make(
        self, cls: type[VirtualRobot], name: str, given: Mapping[str, Any], limit: float
    ) -> VirtualRobot:
        if is_script(self.path):
            return built(cls, name, given)
        try:
            robot = make(cls, lambda: built(cls, name, given), name, self.path, limit=limit)
        except BaseException:
            forget(cls.__module__)
            raise
        keep_with(robot)
        return robot


def _version_of(robot: VirtualRobot) -> str:
    """Return what the author calls the version of a page; empty: nothing."""
    found = getattr(type(robot), "version", "")
    return found if isinstance(found, str) else ""


def _thawed(
    robot: VirtualRobot, path: str, limit: float, version: str, state: dict[str, Any]
) -> dict[str, Any]:
    """Have a page bring the fields of another version into its form.

    Raises:
        BrokenSource: it raises, does not end within `limit` [s], or returns something else than fields.
    """
    file = "" if is_script(path) else text_of(type(robot))
    found: object = within(lambda: robot.thaw(state, version), path, file, limit)
    try:
        built = msgspec.to_builtins(found, builtin_types=(bytes,), enc_hook=to_plain)
        plain = msgspec.convert(built, dict[str, Any])
    except (TypeError, ValueError, RecursionError, msgspec.MsgspecError) as error:
        raise BrokenSource(path=path, reason=f"thaw returns what cannot be kept: {error}") from None
    return plain


def _expect_python(source: str, path: str) -> None:
    """Refuse a file of another kind in words, not with what Python finds wrong in it."""
    try:
        parse(source)
    except (SyntaxError, ValueError):
        raise BrokenSource(path=path, reason="it is no Python page, script or bundle") from None


def is_script(path: str) -> bool:
    """Whether a file holds a script, which is no Python."""
    return path.lower().endswith((".yaml", ".yml", ".clp"))


def bundle_of(page: Create | KeptPage) -> Bundle:
    """Return the page of a request, or of a journal."""
    return Bundle(page.source, page.path, page.wanted, page.files, page.signed, page.sender)
