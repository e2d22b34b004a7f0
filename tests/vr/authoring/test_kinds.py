"""A kind is a name and the commands that it promises; the shipped interfaces say what the robots can."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Annotated, Any

import pytest

from robotree.kinds import Arm as ArmKind
from robotree.kinds import Rover as RoverKind
from robotree.tui.line.carrying import Silent
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import stubs
from robotree.vr import Child, Children, Kind, Robot, Unit, VirtualRobot, Within, command, promised
from robotree.vr.author.command import commands_of
from robotree.vr.author.fitting import misfit
from robotree.vr.author.kind import promises_of
from robotree.vr.author.stubs import interface
from robotree.vr.author.virtual_robot import slot_specs
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import DoesNotFit
from robotree.vr.bundle import Bundle
from tests.vr.authoring.test_values import Painter
from tests.vr.core.conftest import Realm, refusal

sys.path.insert(0, str(Path(__file__).parents[3] / "docs"))
import kinds as written  # docs/kinds.py

sys.path.pop(0)


class Arm(Robot):
    """A class of the author that happens to have this name."""

    @command
    def rise(self) -> None:
        """Stand up."""


class Picker(VirtualRobot):
    """Uses an arm."""

    arm = Child("Arm")
    arms = Children("Arm", least=0)

    @command
    def pick(self) -> None:
        self.arm.go_to(x=0.1, y=0, z=0, twist=0)
        self.arms[1].grip.start(action="open")
        for arm in self.arms:
            arm.hold()
        helper = lambda: self.arm.grip(action="close")  # noqa: E731 # what is nested counts, too
        helper()

    get_info = arm.exposed()


class Typed(VirtualRobot):
    """Says which interface it wants."""

    arm = Child(ArmKind)
    rovers = Children(RoverKind, least=0, most=2)


async def test_an_own_class_of_the_same_name_does_not_fit_an_arm_slot(realm: Realm) -> None:
    mine = await realm.start(Arm("mine"))
    for parent in (Picker("picker"), Typed("typed")):
        agent = await realm.start(parent)
        error = await refusal(realm.client(agent).enslave("arm", mine.address))
        assert isinstance(error, DoesNotFit)
        name = "picker.arm takes" if parent.name == "picker" else "typed.arm takes"
        assert f"{name} a robot of kind Arm; mine has this kind, but has no command " in str(error)
        assert agent.description().slots[0].child is None
        assert mine.description().bond is None, "it was not disturbed"


class LetsThrough(VirtualRobot):
    """Only lets a command through."""

    arm = Child("Arm")
    wave = arm.exposed()


async def test_an_exposed_command_that_the_child_lacks_is_refused_when_it_is_enslaved(realm: Realm) -> None:
    mine, agent = await realm.start(Arm("mine")), await realm.start(LetsThrough("through"))
    error = await refusal(realm.client(agent).enslave("arm", mine.address))
    assert isinstance(error, DoesNotFit)
    assert "mine has this kind, but has no command wave, which the page uses; it has: rise" in str(error)


def test_a_name_expects_what_the_page_uses_and_an_interface_what_it_promises() -> None:
    used = {slot.name: slot.commands for slot in slot_specs(Picker)}
    assert used == {"arm": ("get_info", "go_to", "grip"), "arms": ("grip", "hold")}
    promised_ = {slot.name: slot.commands for slot in slot_specs(Typed)}
    assert promised_["arm"] == ("get_info", "go_to", "grip", "halt", "hold")
    assert promised_["rovers"] == ("get_info", "halt", "move")


class Gripper(Kind):
    """Opens and closes."""

    @promised(effect="repeat")
    def grip(self, width: Annotated[float, Unit("m")], force: Annotated[float, Unit("N")] = 5.0) -> int:
        """Bring the fingers to a width."""
        raise NotImplementedError


def robot(**annotations: Any) -> RobotDescription:
    """Describe a robot with the command `grip`."""

    def grip(self: Any, **_: Any) -> None: ...

    returned = annotations.pop("returned", int)
    parameters = "".join(f", {name}: ANN[{name!r}]" for name in annotations)
    scope: dict[str, Any] = {"ANN": annotations, "R": returned, "command": command, "Robot": Robot}
    source = f"class Mine(Robot):\n @command\n def grip(self{parameters}) -> R: ...\n"
    exec(source, scope)  # noqa: S102 # one signature for each row
    return written.described(scope["Mine"], {})


METRES, NEWTONS = Annotated[float, Unit("m")], Annotated[float, Unit("N")]


@pytest.mark.parametrize(
    ("annotations", "reason"),
    [
        ({"width": METRES}, "has a command grip that takes no force"),
        (
            {"width": Annotated[float, Unit("cm")], "force": NEWTONS},
            "has a command grip that takes width as float in cm instead of float in m",
        ),
        ({"width": str, "force": NEWTONS}, "takes width as str instead of float in m"),
        ({"width": METRES, "force": NEWTONS}, "has a command grip that cannot do without force"),
        ({"width": METRES, "force": NEWTONS | None, "hard": bool}, "has a command grip that"),
    ],
)
def test_a_command_that_breaks_the_promise_says_how(annotations: dict[str, Any], reason: str) -> None:
    assert reason in misfit(robot(**annotations), promises_of(Gripper), ())


def test_what_is_no_kind_is_refused_where_it_is_written() -> None:
    with pytest.raises(TypeError, match="3 is no kind; write the name of a class, such as 'Arm'"):
        Child(3)  # type: ignore[call-overload]


def test_the_shipped_kinds_are_those_of_the_robots() -> None:
    for name, text in written.modules().items():
        assert (written.FOLDER / name).read_text(encoding="utf-8") == text, "run: python docs/kinds.py"


def test_what_robots_promise_they_keep() -> None:
    known = written.classes()
    for kind, cls in known.items():
        found = Bundle.read(written.FOLDER / f"{kind.lower()}.py").source
        assert f"class {kind}(Kind):" in found
        module: Any = __import__("robotree.kinds", fromlist=[kind])
        assert misfit(written.described(cls, known), promises_of(getattr(module, kind)), ()) == ""


async def test_the_interface_of_a_living_robot_is_a_kind(
    realm: Realm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    painter = await realm.start(Painter("painter"))

    class One:
        """A realm client of one robot."""

        async def describe(self, _name: str) -> RobotDescription:
            return painter.description()

    line = Line("stubs", {"NAME": "painter", "--out": str(tmp_path / "painter_kind.py")})
    said = await stubs(One(), line, Silent())  # type: ignore[arg-type]
    assert said.text.endswith("from painter_kind import Painter; then: Child(Painter)")
    source = (tmp_path / "painter_kind.py").read_text()
    assert source == interface(painter.description(), origin="Written by `robotree stubs painter`.")
    monkeypatch.syspath_prepend(str(tmp_path))
    kind = importlib.import_module("painter_kind").Painter
    assert misfit(painter.description(), promises_of(kind), ()) == ""
    lacks = misfit(painter.description(), promises_of(Gripper), ())
    assert lacks.startswith("has no command grip; it has: follow")
    del sys.modules["painter_kind"]


class Slide(Kind):
    """Goes to and fro; one of its commands has a `within` of its own."""

    @promised
    def go(self, far: float, *, within: Within = None) -> None:
        raise NotImplementedError

    @promised
    def search(self, within: Annotated[float, Unit("m")]) -> float:
        raise NotImplementedError


def test_the_limit_of_a_call_is_no_parameter_that_a_kind_promises() -> None:
    go, search = promises_of(Slide)
    assert [field.name for field in go.parameters] == ["far"]
    assert [(field.name, field.unit) for field in search.parameters] == [("within", "m")]
    slide = RobotDescription(address=Address("robot", "s", "1"), kinds=("Slide",), commands=(go, search))
    source = interface(slide, origin="Written by a test.")
    assert "    far: float,\n        *,\n        within: Within = None,\n" in source
    assert source.count("Within") == 2, "imported, and used for one command"


class Limited(VirtualRobot):
    """Takes a limit as if it were an argument."""

    @command
    def go(self, within: Within = None) -> None:
        """Go."""


def test_a_command_takes_no_limit_itself() -> None:
    with pytest.raises(TypeError, match=r"Limited\.go: parameter 'within'"):
        commands_of(Limited)
