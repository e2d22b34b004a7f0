"""Fakes: robots that are made from the description of a kind, and do nothing but answer.

A fake is a robot like any other: its agent, its core, its lease and the check of its arguments are the real
ones. Only what its commands do is replaced: each takes a while of virtual time, reports its progress, and
returns what the test says. What is commanded is remembered: after `go_to(x=0.3, …)` the `x` of `get_info`
is 0.3, if `go_to` promises that a repetition ends the same (`effect="repeat"`).
"""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

import msgspec

from robotree.testing.parts import Fault, Part, Stage
from robotree.vr.author.command import commands_of, give_commands
from robotree.vr.author.kind import Kind as Interface
from robotree.vr.author.kind import Promised, promises_of
from robotree.vr.author.robot import Robot
from robotree.vr.author.signature import Command
from robotree.vr.author.virtual_robot import VirtualRobot, exposures_of
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription, offered
from robotree.vr.base.errors import CommandFailed, VrError

if TYPE_CHECKING:
    from robotree.testing.journal import Step

USUAL_TIME = 1.0
"""[s] of virtual time that a command takes which moves, unless the test says otherwise."""
PARTS = 10
"""Times that such a command reports its progress."""


class Turns:
    """Results that are given one after the other; the last one again and again. Made by `in_turn`."""

    def __init__(self, values: Sequence[Any]) -> None:
        """Take the values: results, errors that are raised, or functions that compute."""
        if not values:
            raise ValueError("in_turn() needs at least one result")
        self.values = tuple(values)


def in_turn(*results: Any) -> Turns:
    """Return one result after the other, and the last one again and again; an error among them is raised."""
    return Turns(results)


class Fake(Part):
    """A robot of a kind that does nothing but answer; see the module."""

    def __init__(
        self, kind: Source, /, *, takes: float | Mapping[str, float] = USUAL_TIME, **results: Any
    ) -> None:
        """Describe it; the same fake can take part in several rehearsals, one after the other.

        Args:
            kind: a class with commands, a `RobotDescription`, or the path of a file with one as JSON.
            takes: [s] of virtual time that a command takes which moves; by its name, or for all.
            **results: of each command by its name: a value (of several parts, those that matter; the others
                are zero), a function of the command's arguments, `in_turn(…)`, or an error that is raised.

        Raises:
            TypeError: the kind describes no robot, or a result is not what the command promises.
            ValueError: there is no such command or part of a result.
        """
        super().__init__()
        self.kind: Kind = kind_of(kind)
        self.takes = takes
        self.results = dict(results)
        for name, result in results.items():
            self._check_result(name, result)
        for name in takes if isinstance(takes, Mapping) else ():
            self._spec(name)
        self.robot: FakeRobot | None = None
        """The robot of the present rehearsal, or of the last one."""
        self._plans: dict[str, list[Fault]] = {}

    def refuse(
        self, command: str = "", *, at: int | None = 1, why: str = "", error: Exception | None = None
    ) -> Self:
        """Have a command fail.

        Args:
            command: its name; empty: any that moves.
            at: at its how-manieth call, from 1; None: at each.
            why: the detail of the `CommandFailed` that is raised.
            error: raised instead of that one.
        """
        return self._add(Fault(what="refuse", command=command, at=at, why=why, error=error))

    def delay(self, command: str = "", *, by: float, at: int | None = None) -> Self:
        """Have a command take longer by some time [s]; else as `refuse`."""
        return self._add(Fault(what="delay", command=command, at=at, by=by))

    def known_commands(self) -> Sequence[str]:
        return tuple(self.kind.commands)

    def enter(self, team: Stage, path: str, name: str) -> None:
        self._plans.clear()
        self.robot = robot = robot_of(self, team, name)
        team.start_robot(path, robot)

    def struck(self, step: Step, fault: Fault) -> None:
        """See `Part.struck`: the command that begins will look at it."""
        self._plans.setdefault(step.key, []).append(fault)

    def plan(self, key: str) -> list[Fault]:
        """Return what goes wrong in one call."""
        return self._plans.pop(key, [])

    def duration(self, spec: CommandSpec) -> float:
        """Return how long [s] a command takes."""
        if spec.effect == "read":
            return 0.0
        if isinstance(self.takes, Mapping):
            return self.takes.get(spec.name, USUAL_TIME)
        return self.takes

    def _spec(self, name: str) -> CommandSpec:
        spec = self.kind.commands.get(name)
        if spec is None:
            known = offered(self.kind.commands, name)
            raise ValueError(f"{self.kind.names[0]} has no command {name!r}; it has: {known}")
        return spec

    def _check_result(self, name: str, result: Any) -> None:
        """Refuse what could never be the result of a command.

        Raises:
            TypeError: it is of another type.
            ValueError: there is no such command, or no such part of its result.
        """
        spec = self._spec(name)
        if isinstance(result, Turns):
            for each in result.values:
                self._check_result(name, each)
        elif isinstance(result, Mapping):
            parts = {field.name for field in spec.result}
            for part in cast("Mapping[str, Any]", result):
                if part not in parts and parts and "" not in parts:
                    known = ", ".join(sorted(parts))
                    raise ValueError(f"the result of {name} has no part {part!r}; it has: {known}")


class FakeRobot(Robot):
    """The robot of a fake in one rehearsal."""

    fake: Fake
    team: Stage

    def begin(self) -> None:
        """Know nothing yet."""
        self.memory: dict[str, Any] = {}
        """The arguments of the latest commands, by the name of the parameter."""
        self.given: Counter[str] = Counter()
        """How many results of each command were given."""

    def readings(self) -> dict[str, float]:
        """See `Robot.readings`: the numbers that were commanded last."""
        memory = dict(self.memory)
        return {name: float(value) for name, value in memory.items() if _is_number(value)}

    def carry_out(self, spec: CommandSpec, arguments: Mapping[str, Any]) -> Any:
        """Do as if: take the time, and return the result.

        Raises:
            Exception: which the test wants, or because the command was ended.
        """
        seconds = self.fake.duration(spec)
        for fault in self.fake.plan(self.context.key):
            if fault.what == "delay":
                seconds += fault.by
            else:
                detail = fault.why or "the test has it fail"
                raise fault.error or CommandFailed(robot=self.name, command=spec.name, detail=detail)
        if seconds > 0.0:
            for part in range(1, PARTS + 1):
                self.sleep(seconds / PARTS)
                self.progress(part / PARTS)
        if spec.effect == "repeat":
            self.memory.update(arguments)
        return self._result(spec, arguments)

    def _result(self, spec: CommandSpec, arguments: Mapping[str, Any]) -> Any:
        value = self.fake.results.get(spec.name)
        if isinstance(value, Turns):
            turn = min(self.given[spec.name], len(value.values) - 1)
            self.given[spec.name] += 1
            value = value.values[turn]
        if isinstance(value, Exception):
            raise value
        if callable(value) and not isinstance(value, type):
            value = self._computed(value, spec, arguments)
        return self._filled_in(blank(spec.result), value)

    def _filled_in(self, nothing: Any, value: Any) -> Any:
        """Return a result, whose missing parts are those commanded last, else nothing."""
        if _is(dict, nothing) and (value is None or _is(Mapping, value)):
            known = {name: self.memory[name] for name in nothing if name in self.memory}
            return dict(nothing) | known | dict(value or {})
        return nothing if value is None else value

    def _computed(self, function: Callable[..., Any], spec: CommandSpec, arguments: Mapping[str, Any]) -> Any:
        """Return what a function of the test makes of the arguments; defaults are filled in.

        Raises:
            VrError: which it raises; anything else is the test's own mistake, and is raised in the test.
        """
        full = {field.name: field.default for field in spec.parameters} | dict(arguments)
        try:
            return function(**_taken_by(function, full))
        except VrError:
            raise
        except Exception as error:
            self.team.mistake = self.team.mistake or error
            raise


def robot_of(fake: Fake, team: Stage, name: str) -> FakeRobot:
    """Return a robot whose commands do what a fake says."""
    kind = fake.kind
    members: dict[str, Any] = {
        "__doc__": kind.doc,
        "kinds": classmethod(lambda _: kind.names),
        "reading_units": dict(kind.units),
    }
    cls = type(kind.names[0], (FakeRobot,), members)
    give_commands(
        cls,
        {
            name: Command(spec, _played(spec), kind.returns.get(name, Any))
            for name, spec in kind.commands.items()
        },
    )
    robot: FakeRobot = cls(name)
    robot.fake, robot.team = fake, team
    robot.begin()
    return robot


def _played(spec: CommandSpec) -> Callable[..., Any]:
    def play(robot: FakeRobot, **arguments: Any) -> Any:
        return robot.carry_out(spec, arguments)

    return play


def _taken_by(function: Callable[..., Any], arguments: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return those of the arguments that a function takes."""
    parameters = inspect.signature(function).parameters
    if any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values()):
        return arguments
    return {name: value for name, value in arguments.items() if name in parameters}


def _is(kind: type[Any], value: Any) -> bool:
    return isinstance(value, kind)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


# -- kinds: names, commands and their results --------------------------------------------------------


Source = type[Any] | RobotDescription | str | Path
"""Where a kind is described: a class, a description, or the path of a file with one."""


class Kind(msgspec.Struct, frozen=True):
    """One kind of robot."""

    names: tuple[str, ...]
    """Of its classes, most special first, as in `RobotDescription.kinds`."""
    doc: str
    commands: Mapping[str, CommandSpec]
    returns: Mapping[str, Any]
    """The annotation of each command's result; a description has none, its results are checked by parts."""
    units: Mapping[str, str]
    """Symbol of the unit of each reading."""


def kind_of(source: object) -> Kind:
    """Return the kind that a source describes.

    A source is a class (an interface of `robotree.kinds`, a proxy's or a page's class), a description as a
    living robot gives it, or a file that holds such a description as JSON.

    Raises:
        TypeError: it describes no robot, or declares a command in a way that cannot be called from afar.
        OSError: the file cannot be read.
        ValueError: the file holds no description.
    """
    if isinstance(source, RobotDescription):
        return _from_description(source)
    if isinstance(source, str | Path):
        return _from_description(_read(Path(source)))
    if isinstance(source, type) and issubclass(source, Robot):
        return _from_class(source)
    if isinstance(source, type) and issubclass(source, Interface):
        return _from_interface(source)
    raise TypeError(
        f"{source!r} describes no robot: give a class with commands, such as robotree.kinds.Arm, "
        "a RobotDescription, or the path of a file with one as JSON"
    )


def _read(path: Path) -> RobotDescription:
    try:
        return msgspec.json.decode(path.read_bytes(), type=RobotDescription)
    except msgspec.MsgspecError as error:
        raise ValueError(f"{path} holds no description of a robot: {error}") from None


def _from_description(description: RobotDescription) -> Kind:
    known = {spec.name: msgspec.structs.replace(spec, through="") for spec in description.commands}
    return Kind(description.kinds, description.doc, known, {}, description.units)


def _from_class(cls: type[Robot]) -> Kind:
    commands: Mapping[str, Command] = commands_of(cls)
    exposed = dict(_exposed_by(cls)) if issubclass(cls, VirtualRobot) else {}
    return Kind(
        cls.kinds(),
        (cls.__doc__ or "").strip(),
        {name: each.spec for name, each in commands.items()} | exposed,
        {name: each.returns for name, each in commands.items()},
        dict(cls.reading_units),
    )


def _from_interface(cls: type[Interface]) -> Kind:
    promises = promises_of(cls)
    names = tuple(
        base.__name__ for base in cls.__mro__ if issubclass(base, Interface) and base is not Interface
    )
    return Kind(
        (*names, Robot.__name__),
        (cls.__doc__ or "").strip(),
        {spec.name: spec for spec in promises},
        {spec.name: _returned_by(getattr(cls, spec.name)) for spec in promises},
        {},
    )


def _returned_by(promise: Promised[..., Any]) -> Any:
    return promise.signature().returns


def _exposed_by(cls: type[VirtualRobot]) -> Iterator[tuple[str, CommandSpec]]:
    """Yield the commands that a page lets through, where the kind of the child is one that ships.

    Raises:
        TypeError: it is of another kind, so nothing is known of its commands.
    """
    for name, exposed in exposures_of(cls).items():
        kind = _shipped(exposed.child.kind)
        spec = None if kind is None else kind.commands.get(exposed.command)
        if spec is None:
            raise TypeError(
                f"{cls.__name__}.{name} is a command of its {exposed.child.kind}, which is not known here; "
                f"rehearse the page itself, as Page({cls.__name__}, {exposed.child.name}=...), or give the "
                "description of a living robot"
            )
        yield name, msgspec.structs.replace(exposed.seen(spec), name=name)


def _shipped(name: str) -> Kind | None:
    from robotree import kinds

    found = getattr(kinds, name, None)
    return None if found is None else _from_interface(found)


def blank(fields: tuple[FieldSpec, ...]) -> Any:
    """Return a result of zeros, no, empty texts and first choices; None when there is none."""
    if not fields:
        return None
    if len(fields) == 1 and not fields[0].name:
        return _nothing(fields[0])
    return {field.name: _nothing(field) for field in fields}


def _nothing(field: FieldSpec) -> Any:
    if field.nullable:
        return None
    match field.type:
        case "float" | "int":
            low = float("-inf") if field.lower is None else field.lower
            high = float("inf") if field.upper is None else field.upper
            number = min(max(0.0, low), high)
            return number if field.type == "float" else int(number)
        case "tuple":
            return [_nothing(item) for item in field.items]
        case "record":
            return {item.name: _nothing(item) for item in field.items}
        case "choice":
            return field.choices[0]
        case _:
            return _EMPTY[field.type]


_EMPTY: dict[str, Any] = {"bool": False, "str": "", "list": [], "dict": {}, "bytes": b""}
