from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal

import msgspec
import pytest

from robotree.vr import Child, Range, Robot, Unit, VirtualRobot, command
from robotree.vr.author.command import commands_of
from robotree.vr.author.virtual_robot import exposures_of, slots_of
from robotree.vr.base.description import FieldSpec

Metres = Annotated[float, Unit("m")]


class Pose(msgspec.Struct):
    x: Annotated[float, Unit("m"), "ahead"]
    twist: Annotated[float, Unit("rad")]
    busy: bool


@dataclasses.dataclass
class Grip:
    width: Metres


class Arm(Robot):
    """An arm.

    It grips.
    """

    @command(effect="repeat")
    def go_to(
        self,
        x: Annotated[Metres, Range(-0.7, 0.7), "ahead of the base"],
        *,
        speed: Annotated[float | None, Unit("m/s")] = None,
        elbow: Literal["up", "down"] = "up",
    ) -> None:
        """Go to a point.

        In a straight line.
        """

    @command(effect="read")
    def get_info(self) -> Pose:
        """Tell where it is."""
        return Pose(0, 0, busy=False)

    @command
    def grip(self, width: Metres | None = None, n: int = 1) -> Grip:
        return Grip(width or float(n))

    @command
    def count(self) -> int:
        return 1

    @command
    def anything(self) -> Any:
        return None

    def not_a_command(self) -> None: ...


def test_what_callers_see_of_a_method() -> None:
    go_to = commands_of(Arm)["go_to"].spec
    assert go_to.effect == "repeat"
    assert go_to.doc == "Go to a point.\n\nIn a straight line."
    assert go_to.parameters == (
        FieldSpec(name="x", type="float", unit="m", lower=-0.7, upper=0.7, doc="ahead of the base"),
        FieldSpec(name="speed", type="float", unit="m/s", nullable=True, required=False),
        FieldSpec(name="elbow", type="choice", choices=("up", "down"), required=False, default="up"),
    )
    assert go_to.result == ()


def test_results_have_typed_parts() -> None:
    specs = {name: found.spec for name, found in commands_of(Arm).items()}
    assert list(specs) == ["go_to", "get_info", "grip", "count", "anything"]
    assert specs["get_info"].result == (
        FieldSpec(name="x", type="float", unit="m", doc="ahead"),
        FieldSpec(name="twist", type="float", unit="rad"),
        FieldSpec(name="busy", type="bool"),
    )
    assert specs["grip"].result == (FieldSpec(name="width", type="float", unit="m"),)
    assert specs["count"].result == (FieldSpec(name="", type="int"),)
    assert specs["anything"].result == ()


def test_a_command_stays_an_ordinary_method() -> None:
    assert Arm("arm-1").grip(0.05).width == 0.05


def test_kinds_are_the_classes_most_special_first() -> None:
    class FastArm(Arm): ...

    assert FastArm.kinds() == ("FastArm", "Arm", "Robot")


def test_a_subclass_inherits_overrides_and_removes_commands() -> None:
    class Lame(Arm):
        grip = None  # type: ignore[assignment]

        @command(effect="read")
        def count(self) -> int:
            return 2

    assert list(commands_of(Lame)) == ["go_to", "get_info", "count", "anything"]
    assert commands_of(Lame)["count"].spec.effect == "read"
    assert commands_of(Arm)["count"].spec.effect == "once"


def test_slots_and_exposures_are_declared_in_the_class() -> None:
    class Square(VirtualRobot):
        rover = Child("Rover", "what drives")
        move = rover.exposed()
        drive = rover.exposed("move")

    class Cube(Square):
        lift = Child("Lift")
        drive = None  # type: ignore[assignment]

    assert {name: child.kind for name, child in slots_of(Cube).items()} == {"rover": "Rover", "lift": "Lift"}
    assert {name: exposed.command for name, exposed in exposures_of(Cube).items()} == {"move": "move"}
    cube = Cube("cube")
    assert not cube.rover
    assert str(cube.rover) == "nobody in rover"
    assert [spec.doc for spec in cube.child_slots.specs()] == ["what drives", ""]


@dataclass
class Tree:
    below: list[Tree]


class Side(Enum):
    LEFT = 1


def declare(function: Any) -> type[Robot]:
    function.__qualname__ = f"Odd.{function.__name__}"
    return type("Odd", (Robot,), {function.__name__: command(function)})


def test_an_author_is_told_what_is_wrong_with_a_command() -> None:
    """What a page cannot easily show; the rest is in `authoring/test_mistakes.py`."""

    def recursive(self: Any, x: Tree) -> None: ...
    def picture(self: Any, x: bytes) -> None: ...
    def starry(self: Any, *x: float) -> None: ...
    def ranged(self: Any, x: Annotated[str, Range(0, 1)]) -> None: ...
    def numbers_as_keys(self: Any, x: dict[int, float]) -> None: ...
    def unsaid(self: Any, x: dict) -> None: ...  # type: ignore[type-arg]
    def unknown(self: Any, x: Metre) -> None: ...  # type: ignore[name-defined]  # noqa: F821
    def _hidden(self: Any) -> None: ...

    sentences = {
        recursive: "Odd.recursive: parameter 'x': its 'below': a value of it contains itself: a Tree cannot "
        "lie in a Tree",
        picture: "Odd.picture: parameter 'x' cannot be bytes: only a result can",
        starry: "Odd.starry: parameter 'x': a command takes named parameters only",
        ranged: "Odd.ranged: parameter 'x': only numbers have a unit or a range",
        numbers_as_keys: "Odd.numbers_as_keys: parameter 'x' cannot be dict[int, float]: the keys are texts: "
        "write dict[str, …]",
        unsaid: "Odd.unsaid: parameter 'x' does not say what is in it: write for example dict[str, float]",
        unknown: "Odd.unknown: name 'Metre' is not defined; define it in the file, outside of functions",
        _hidden: "Odd._hidden: a command cannot have this name; every robot uses it itself",
    }
    for function, sentence in sentences.items():
        with pytest.raises(TypeError) as refused:
            commands_of(declare(function))
        assert str(refused.value) == sentence


def test_the_inside_of_a_command_works_only_there() -> None:
    with pytest.raises(RuntimeError, match="only inside a running command"):
        Arm("arm-1").sleep(1)
