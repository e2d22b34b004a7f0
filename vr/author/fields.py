"""The fields that a page keeps beside its code: settings, which people may change, and declared state.

    speed: Annotated[float, Unit("m/s"), Range(0.01, 0.3)] = 0.1     a setting
    picked: int = state(0)                                           declared state
    seen: list[str] = state([])

Both are part of the state of the robot's core (`core/machine.py`), and are changed by its event `Set` alone.
Plain values are kept, as they are encoded; a page gets copies. What a command changes inside a list, a dict
or the like is noticed and kept when the command ends, however it ends (`Kept.settle`). Pure.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, ClassVar, Final, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import msgspec

from robotree.vr.author.context import activity_here
from robotree.vr.author.robot import Robot, attributes_of
from robotree.vr.author.signature import field_with_default
from robotree.vr.author.typed import needs_building, unwrapped
from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import CommandSpec, FieldSpec
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.plain import to_plain
from robotree.vr.base.units import Range, Unit, shorten

SET = "set"
"""The command of every robot with settings that changes them."""
LARGEST = 100_000
"""[bytes] of one field, encoded: state is no place for pictures."""

_T = TypeVar("_T")
_SIMPLE = (float, int, bool, str)
_AT_ONCE = (float, int, bool, str, bytes, type(None))
"""Types of values that nobody can change in place."""


_encode = msgspec.msgpack.Encoder(enc_hook=to_plain).encode
_decode: Callable[[bytes], Any] = msgspec.msgpack.Decoder().decode


def state(default: _T) -> _T:
    """Declare state of a virtual robot in the body of its class.

    It is written with a type: `picked: int`, an equals sign, and this with the default.

    Args:
        default: its value when the robot is created: numbers, texts, bytes, lists, dicts, tuples, sets,
            dataclasses and `msgspec.Struct`s of such.

    Returns:
        For a type checker, the default; what stands in the class reads and keeps the value of each robot.
    """
    return cast("_T", StateField(default))


class Field:
    """One value that a robot keeps. In a class, it is the default."""

    name = ""

    def __init__(self, default: Any) -> None:
        """Made for a class, by `declare` and `state`."""
        self.default = default

    def __set_name__(self, owner: type[Any], name: str) -> None:
        self.name = name

    def __get__(self, robot: Any, owner: type[Any]) -> Any:
        return self.default if robot is None else robot.field_values.read(self)

    def __set__(self, robot: Any, value: Any) -> None:
        robot.field_values.write({self.name: self.plain(value, robot.field_values.robot)})

    def plain(self, value: Any, robot: str) -> Any:
        """Return a value as it is kept.

        Args:
            value: of this field.
            robot: name of the robot, for messages.

        Raises:
            BadArgument: a setting cannot have it.
            TypeError: declared state cannot.
        """
        raise NotImplementedError

    def typed(self, plain: Any) -> Any:
        """Return what is kept as the page reads it: a copy of what can be changed in place."""
        return plain

    def fits(self, plain: Any) -> bool:
        """Whether a value that was kept by another page of the robot can stay."""
        try:
            self.plain(self.typed(plain), "")
        except (BadArgument, TypeError, ValueError):  # msgspec's refusals are ValueErrors
            return False
        return True


class Setting(Field):
    """A number, truth, text, choice or tuple that people may change while the robot runs."""

    def __init__(self, default: Any, spec: FieldSpec, annotation: Any) -> None:
        """Take what a form and a check need of it, and the type that the page reads."""
        super().__init__(default)
        self.spec = spec
        self._built = annotation if needs_building(annotation) else None

    def plain(self, value: Any, robot: str) -> Any:
        """See `Field.plain`: text may name another unit."""
        if isinstance(value, Enum):
            value = value.value
        return check_argument(self.spec, value, command=f"{robot}.{SET}" if robot else SET)

    def typed(self, plain: Any) -> Any:
        """See `Field.typed`: a member of an Enum, or a tuple, is made of what is kept."""
        return plain if self._built is None else msgspec.convert(plain, self._built)


class StateField(Field):
    """State that a page has declared with `state`."""

    annotation: Any = Any

    def bind(self, annotation: Any, where: str) -> None:
        """Take the type from the class, and refuse what cannot be kept.

        Raises:
            TypeError: the type cannot be encoded, or the default is of another one.
        """
        wrong = _unfit(annotation)
        if wrong:
            raise TypeError(
                f"{where} cannot keep {wrong}: use numbers, texts, bytes, lists, dicts, tuples, sets, "
                "dataclasses or msgspec.Structs of such"
            )
        self.annotation = annotation
        try:
            self.plain(self.default, where.removesuffix(f".{self.name}"))
        except TypeError as error:
            raise TypeError(f"default of {error}") from None

    def plain(self, value: Any, robot: str) -> Any:
        where = f"{robot}.{self.name}"
        try:
            body = _encode(value)
            plain = _decode(body)
            self.typed(plain)
        except (TypeError, ValueError, OverflowError, RecursionError, msgspec.MsgspecError) as error:
            raise TypeError(f"{where} cannot keep {shorten(value)}: {error}") from None
        if len(body) > LARGEST:
            raise TypeError(f"{where} cannot keep {len(body)} bytes: at most {LARGEST}, encoded")
        return plain

    def typed(self, plain: Any) -> Any:
        if self.annotation is Any:
            return _decode(_encode(plain))
        return msgspec.convert(_decode(_encode(plain)), self.annotation, strict=True, builtin_types=(bytes,))


class Kept:
    """The fields of one robot: its own before it starts, from then on those of its core."""

    def __init__(self, cls: type[Any]) -> None:
        """Begin with the defaults of a class."""
        self.fields = fields_of(cls)
        self.robot = ""
        """Name of the robot, for messages."""
        own: dict[str, Any] = {name: field.plain(field.default, "") for name, field in self.fields.items()}
        self._now: Callable[[], dict[str, Any]] = lambda: own
        self._change: Callable[[dict[str, Any]], None] | None = None
        self._copies: dict[str, dict[str, _Copy]] = {}
        """Values that running commands have read and may change in place, by key of the command."""
        self.thaw: Callable[[dict[str, Any]], dict[str, Any]] | None = None
        """Brings the values of another version of the page into the form of this one."""
        self.other_version = False
        """Whether the author calls the version of this page otherwise than that of the other one."""

    @property
    def values(self) -> dict[str, Any]:
        """The kept fields, as plain values."""
        return self._now()

    def live(self, now: Callable[[], dict[str, Any]], change: Callable[[dict[str, Any]], None]) -> None:
        """Be those of a core from now on: `now` returns them, and `change` has the core keep others."""
        self._now, self._change = now, change

    def give(self, given: Mapping[str, Any]) -> None:
        """Have values that come from outside; they are checked."""
        self.values.update(given)

    def taken_over(self, values: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
        """Return the values with which this page goes on from those of another, and what could not stay.

        Returns:
            A value for each of its fields, and sentences.

        Raises:
            BrokenSource: the page has a `thaw`, which does not bring them into its form.
        """
        kept, notes = self._as_they_fit(values)
        if self.thaw is None or not (notes or self.other_version):
            return kept, notes
        return self._as_they_fit(self.thaw(dict(values)))

    def _as_they_fit(self, values: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
        notes = [
            f"{name} is gone, with its value {shorten(values[name])}" for name in values.keys() - self.fields
        ]
        kept: dict[str, Any] = {}
        for name, field in self.fields.items():
            kept[name] = field.plain(field.default, "")
            if name not in values:
                notes.append(f"{name} is new and begins with {shorten(kept[name])}")
            elif field.fits(values[name]):
                kept[name] = values[name]
            else:
                notes.append(
                    f"{name} cannot be {shorten(values[name])} any more: it is {shorten(kept[name])}"
                )
        return kept, sorted(notes)

    def read(self, field: Field) -> Any:
        """Return a value as the page reads it."""
        plain = self.values.get(field.name, field.default)  # a reader of a page that was reloaded meanwhile
        activity = activity_here()
        if activity is not None:
            plain = activity.kept(field.name, plain)
        if activity is None or isinstance(field, Setting):
            return field.typed(plain)
        copies = self._copies.setdefault(activity.call_key, {})
        copy = copies.get(field.name)
        if copy is None or (copy.plain is not plain and not copy.changed):
            copy = _Copy(plain, field.typed(plain))
            if type(copy.value) in _AT_ONCE:
                return copy.value
            copies[field.name] = copy
        return copy.value

    def write(self, values: dict[str, Any]) -> None:
        """Keep other values; they are checked."""
        activity = activity_here()
        if activity is not None:
            for name in values:
                self._copies.get(activity.call_key, {}).pop(name, None)
        if self._change is None:
            self.values.update(values)
        elif activity is None:
            self._change(values)
        else:
            activity.keep_values(values, self._change)

    def keep(self, key: str) -> None:
        """Keep what a running command has changed in place so far. By our own code only.

        Raises:
            TypeError: something in it cannot be kept; nothing is.
        """
        changed = {name: copy for name, copy in self._copies.get(key, {}).items() if copy.changed}
        values = {name: self.fields[name].plain(copy.value, self.robot) for name, copy in changed.items()}
        if values and self._change is not None:
            self._change(values)
            for name, copy in changed.items():
                copy.keep(values[name])

    def forget(self, key: str) -> None:
        """Have a running command read its fields anew. By our own code only."""
        self._copies.pop(key, None)

    def settle(self, key: str) -> None:
        """A command has ended: keep what it has changed in place. By our own code only.

        Raises:
            TypeError: something in it cannot be kept; the rest is.
        """
        copies = self._copies.pop(key, {})
        refusals: list[str] = []
        values: dict[str, Any] = {}
        for name, copy in copies.items():
            if copy.changed:
                try:
                    values[name] = self.fields[name].plain(copy.value, self.robot)
                except TypeError as error:
                    refusals.append(str(error))
        if values and self._change is not None:
            self._change(values)
        if refusals:
            raise TypeError("; ".join(refusals))


class _Copy:
    """One value that a command has read and may change in place."""

    __slots__ = ("_body", "plain", "value")

    def __init__(self, plain: Any, value: Any) -> None:
        self.plain, self.value, self._body = plain, value, _encode(value)

    def keep(self, plain: Any) -> None:
        """Take note that it is kept as it is now."""
        self.plain, self._body = plain, _encode(self.value)

    @property
    def changed(self) -> bool:
        """Whether it is another value than the one that was read."""
        try:
            return _encode(self.value) != self._body
        except Exception:  # noqa: BLE001 # it has been changed into something that cannot be kept
            return True


# -- of a class ------------------------------------------------------------------------------------


def declare(cls: type[Any]) -> None:
    """Find the settings and the state that a class itself declares, and put them in place.

    Raises:
        TypeError: one is declared in a way that cannot be kept or shown.
    """
    annotations: dict[str, Any] = inspect.get_annotations(cls)
    for name, value in list(vars(cls).items()):
        where = f"{cls.__name__}.{name}"
        if isinstance(value, StateField):
            if name not in annotations:
                raise TypeError(f"{where} needs a type: `{name}: int = state(0)`")
            value.bind(_evaluated(annotations[name], cls, where), where)
        elif name in annotations and not name.startswith("_") and isinstance(value, (*_AT_ONCE, Enum, tuple)):
            setting = _setting(cls, name, annotations[name], value)
            if setting is not None:
                setting.name = name
                setattr(cls, name, setting)


def _setting(cls: type[Any], name: str, annotation: Any, default: Any) -> Setting | None:
    """Return the setting that a typed attribute declares; None: it is an ordinary one."""
    where = f"{cls.__name__}.{name}"
    annotation = _evaluated(annotation, cls, where)
    bare, extras, _ = unwrapped(annotation)
    if get_origin(bare) in {ClassVar, Final} or bare in {ClassVar, Final}:
        return None
    annotated = any(isinstance(extra, Unit | Range) for extra in extras)
    if not annotated and not _simple(bare):
        return None
    if hasattr(Robot, name):
        if annotated:
            raise TypeError(f"{where}: a setting cannot have this name; every robot uses it itself")
        return None
    return Setting(default, field_with_default(name, annotation, default, where, cls.__name__), annotation)


def _simple(annotation: Any) -> bool:
    """Whether a value is a number, a truth, a text, a choice, or a tuple of such, or may be None instead."""
    annotation, _, _ = unwrapped(annotation)
    if get_origin(annotation) is Literal:
        return all(isinstance(argument, str) for argument in get_args(annotation))
    if get_origin(annotation) is tuple:
        return all(argument is ... or _simple(argument) for argument in get_args(annotation))
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return all(isinstance(member.value, str) for member in annotation)
    return annotation in _SIMPLE


def _evaluated(annotation: Any, cls: type[Any], where: str) -> Any:
    """Return an annotation that may be written as a text.

    Raises:
        TypeError: it names something that is not there.
    """
    if not isinstance(annotation, str):
        return annotation
    alone = type(cls.__name__, (), {"__annotations__": {"it": annotation}, "__module__": cls.__module__})
    try:
        return get_type_hints(alone, localns=dict(vars(cls)), include_extras=True)["it"]
    except NameError as error:
        raise TypeError(f"{where}: {error}; define it in the file, above the class") from None


def fields_of(cls: type[Any]) -> dict[str, Field]:
    """Return the settings and the state that a class and its bases declare, by name, in their order."""
    return {name: value for name, value in attributes_of(cls).items() if isinstance(value, Field)}


def settings_spec(cls: type[Any]) -> CommandSpec:
    """Return how the command `set` of a class looks; without parameters where it has no settings."""
    return CommandSpec(
        name=SET,
        doc="Change settings; what is not given stays as it is. It runs beside other commands.",
        effect="repeat",
        beside=True,
        parameters=tuple(field.spec for field in fields_of(cls).values() if isinstance(field, Setting)),
    )


def _unfit(annotation: Any) -> str:
    """Return the name of a type inside an annotation that cannot be encoded; empty: there is none."""
    from msgspec import inspect as types

    try:
        info = types.type_info(annotation)
    except TypeError as error:
        return str(error)
    waiting: list[Any] = [info]
    seen: set[int] = set()
    while waiting:
        node = waiting.pop()
        if isinstance(node, types.CustomType):
            return node.cls.__name__
        if isinstance(node, tuple | list):
            waiting += cast("list[Any]", node)
        elif isinstance(node, types.Type | types.Field) and id(node) not in seen:
            seen.add(id(node))
            waiting += [getattr(node, name) for name in node.__struct_fields__]
    return ""
