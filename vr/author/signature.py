"""From a method to a command that callers can see: its parameters, its result, and what their types are.

Mistakes of an author are `TypeError`s whose sentence names the class, the command and the parameter.
"""

from __future__ import annotations

import copy
import inspect
import math
import types
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin

import msgspec

from robotree.vr.author.robot import Robot
from robotree.vr.author.typed import USABLE, field_of, hints_of, needs_building, parts_of
from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import Arguments, CommandSpec, Effect, FieldSpec
from robotree.vr.base.errors import BadArgument, CommandFailed
from robotree.vr.base.plain import READY, to_plain
from robotree.vr.base.units import shorten

_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
_FIRST = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
_CHANGEABLE = frozenset({list, dict})
"""Types of arguments that code can change."""
_EFFECTS = ", ".join(map(repr, get_args(Effect)))


Within = Annotated[float | str | None, "longest time of a call: [s], or text with a unit; None: no own limit"]
"""The type of `within`, which interfaces name for type checkers; the command itself has no such parameter."""


ResumePolicy = Literal["continue", "restart", "ask", "abort"]
"""The behaviour of a command whose process has ended in the middle, when it is started again."""


class Resumption(NamedTuple):
    """The behaviour of a command after a crash of its process."""

    policy: ResumePolicy = "continue"
    stale_after: float = math.inf
    """[s] without its process after which a person is asked instead."""


class Command(msgspec.Struct, frozen=True):
    """One command of a class: how it looks, and what runs."""

    spec: CommandSpec
    function: Callable[..., Any]
    """Takes the robot and the arguments by name."""
    returns: Any
    """Annotation of the result; `Any` where there is none."""
    builds: Mapping[str, Any] = {}
    """Annotations of the parameters that the function takes in another form than they travel in."""
    changeable: Mapping[str, Any] = {}
    """Defaults that code can change: each call gets a copy of its own."""
    resumption: Resumption = Resumption()
    """Its behaviour after a crash."""

    def run(self, robot: Robot, arguments: Arguments) -> Any:
        """Call the function, in the thread of the command.

        Args:
            robot: whose command it is.
            arguments: plain and checked.

        Raises:
            BadArgument: a class of the author's refuses to be made of them.
            Exception: what the author's code raises.
        """
        if not _CHANGEABLE.isdisjoint(map(type, arguments.values())):
            arguments = copy.deepcopy(arguments)  # they are part of the robot's state, which no code changes
        given = arguments
        if self.changeable:
            missing = {name: self.changeable[name] for name in self.changeable.keys() - arguments.keys()}
            arguments = {**arguments, **copy.deepcopy(missing)}
        if not self.builds:
            return self.function(robot, **arguments)
        built = {
            name: self._build(name, value) if name in given and name in self.builds else value
            for name, value in arguments.items()
        }
        return self.function(robot, **built)

    def plain_result(self, value: Any, *, robot: str, name: str) -> Any:
        """Return a result as plain values, if it is what the signature promises.

        Args:
            value: what the author's code returned.
            robot: its name.
            name: under which the command was called.

        Raises:
            CommandFailed: it is of another type; names both.
            TypeError: it cannot travel.
        """
        try:
            plain = value if type(value) in READY else to_plain(value)
        except TypeError as error:
            raise TypeError(f"the result {error}") from None
        declared = self.returns
        if declared is not Any and type(plain) is not declared:  # of itself, most often
            try:
                msgspec.convert(plain, declared, strict=True)
            except msgspec.ValidationError as error:
                got = shorten(value)
                bare = get_args(declared)[0] if get_origin(declared) is Annotated else declared
                promised = "nothing" if bare is type(None) else inspect.formatannotation(bare)
                detail = f"it promises {promised} but returned {got}: {error}"
                raise CommandFailed(robot=robot, command=name, detail=detail) from None
        return plain

    def _build(self, name: str, value: Any) -> Any:
        try:
            return msgspec.convert(value, self.builds[name], strict=False)
        except (TypeError, ValueError) as error:
            raise BadArgument(command=self.spec.name, parameter=name, reason=str(error)) from None


def signature_of(function: Callable[..., Any], effect: Effect, *, promised: bool = False) -> Command:
    """Read a method as its callers see it.

    Args:
        function: the undecorated method, `self` first.
        effect: what a repetition does.
        promised: whether it belongs to an interface, where a parameter of the type `Within` is left out.

    Raises:
        TypeError: it is no plain method, an annotation is missing or of a type that cannot travel, or there
            is no such effect.
    """
    hints = hints_of(function, function.__qualname__)
    parameters = _expect_method(function, hints)
    if promised:
        parameters = [one for one in parameters if hints.get(one.name) != Within]
        hints = {name: hint for name, hint in hints.items() if hint != Within}
    if effect not in get_args(Effect):
        raise TypeError(f"{function.__qualname__}: no effect {effect!r}; write one of {_EFFECTS}")
    spec = CommandSpec(
        name=function.__name__,
        doc=inspect.cleandoc(function.__doc__ or ""),
        effect=effect,
        parameters=tuple(_parameter(function, parameter, hints) for parameter in parameters),
        result=tuple(_result(hints.get("return", types.NoneType), function.__qualname__)),
    )
    builds = {name: hint for name, hint in hints.items() if name != "return" and needs_building(hint)}
    changeable = {
        one.name: one.default
        for one in parameters
        if type(one.default).__hash__ is None  # a list, a dict, a set, a record that is not frozen
    }
    return Command(spec, function, hints.get("return", Any), builds, changeable)


def _expect_method(function: Callable[..., Any], hints: Mapping[str, Any]) -> list[inspect.Parameter]:
    """Return the parameters of a command without `self`.

    Raises:
        TypeError: it is no plain method; says what to write instead.
    """
    name = function.__qualname__
    if inspect.iscoroutinefunction(function):
        raise TypeError(f"{name}: write it without async; a command has a thread of its own and may block")
    if inspect.isgeneratorfunction(function) or inspect.isasyncgenfunction(function):
        raise TypeError(
            f"{name}: a command cannot yield; return a list, and tell steps with self.progress(part, text)"
        )
    parameters = list(inspect.signature(function).parameters.values())
    first = parameters[0] if parameters else None
    if first is None or first.kind not in _FIRST or (first.name in hints and first.name != "self"):
        raise TypeError(
            f"{name}: the first parameter of a command is self; write def {function.__name__}(self, …)"
        )
    return parameters[1:]


def field_with_default(name: str, annotation: Any, default: Any, where: str, label: str) -> FieldSpec:
    """Return how a typed value with a default looks to people.

    Args:
        name: of the value.
        annotation: as in the source, evaluated.
        default: its value when none is given.
        where: what it is, for messages about its type.
        label: whose it is, for messages about its default.

    Raises:
        TypeError: it is of a type that cannot travel, or the default is not one that it takes.
    """
    return _with_default(field_of(name, annotation, where), default, label)


def _parameter(
    function: Callable[..., Any], parameter: inspect.Parameter, hints: dict[str, Any]
) -> FieldSpec:
    where = f"{function.__qualname__}: parameter {parameter.name!r}"
    if parameter.kind not in _NAMED:
        raise TypeError(f"{where}: a command takes named parameters only")
    if parameter.name not in hints:
        raise TypeError(f"{where} needs a type: {USABLE}")
    field = field_of(parameter.name, hints[parameter.name], where)
    if _holds_bytes(field):
        raise TypeError(f"{where} cannot be bytes: only a result can")
    if parameter.default is inspect.Parameter.empty:
        return field
    return _with_default(field, parameter.default, function.__qualname__)


def _holds_bytes(field: FieldSpec) -> bool:
    return field.type == "bytes" or any(map(_holds_bytes, field.items))


def _with_default(field: FieldSpec, default: Any, command: str) -> FieldSpec:
    """Return a parameter with its default.

    Raises:
        TypeError: the command would refuse it.
    """
    if default is None and not field.nullable:
        bare = f"{command}: {field.name}: None is no {field.type}"
        raise TypeError(f"default of {bare}; write {field.name}: … | None = None, or another default")
    try:
        field = msgspec.structs.replace(field, required=False, default=to_plain(default))
        check_argument(field, field.default, command=command)
    except TypeError as error:
        raise TypeError(f"default of {command}: {field.name}: {error}") from None
    except BadArgument as error:
        raise TypeError(f"default of {error}") from None
    return field


def _result(annotation: Any, where: str) -> Iterator[FieldSpec]:
    if annotation is None or annotation is types.NoneType or annotation is Any:
        return
    parts = parts_of(annotation, f"{where}: its result") if isinstance(annotation, type) else {}
    if not parts:
        yield field_of("", annotation, f"{where}: its result")
    for name, part in parts.items():
        yield field_of(name, part.annotation, f"{where}: its result's {name!r}", above=(annotation,))
