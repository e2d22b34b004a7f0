"""A kind is a name and the commands that it promises; the shipped interfaces say what the robots can."""

from __future__ import annotations

import contextlib
import importlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import pytest

from robotree.kinds import Arm as ArmKind
from robotree.kinds import Rover as RoverKind
from robotree.tui.cli import main
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


# -- editors and type checkers know the commands of children: right and wrong pages under pyright and
#    mypy ------------------------------------------------------------------------------------------


ROOT = Path(__file__).parents[3]
TOOLS = Path(sys.executable).parent

RIGHT = '''
from robotree.kinds import Arm, Rover
from robotree.vr import Child, Children, VirtualRobot, command


class Right(VirtualRobot):
    """Uses its children as they are."""

    arm = Child(Arm)
    rovers = Children(Rover, least=1, most=4)
    other = Child("Conveyor", optional=True)

    @command
    def go(self, x: float) -> float:
        """Go there."""
        here = self.arm.get_info()
        self.arm.go_to(x=x, y=here.y, z=here.z + 0.1, twist=0)
        self.arm.go_to(x, 0.0, 0.3, 0.0, speed=0.1)
        self.arm.go_to(x=x, y=0, z=0.3, twist=0, within="5 s")
        self.arm.go_to(x, 0, 0.3, 0, within=5)
        self.arm.grip.start(action="open", within="500 ms").result()
        soon: float = self.arm.get_info(within=0.5).z
        moving = self.arm.get_info.start()
        self.arm.grip.tell(action="open")
        height: float = moving.result().z
        for index, rover in self.rovers.items():
            rover.move(x=index * 0.1, y=0)
        first: float = self.rovers[0].get_info().vx
        if self.other:
            self.other.run(speed=1)
        with self.together() as both:
            low: float = both.start(self.arm.get_info).result().z
            both.start(self.arm.go_to, x=0.1, y=0, z=low, twist=0)
            both.start(self.arm.go_to, 0.1, 0, 0.1, 0, speed=0.1)
            both.start(self.fetch, "cup", count=2).result().upper()
            both.start(self.other.run, speed=1)
            for rover in self.rovers:
                both.start(rover.move, x=0.1, y=0).detach()
        with self.first() as race:
            race.start(self.arm.get_info)
            race.start(self.arm.get_info, within="1 s")
        return height + first + soon

    def fetch(self, what: str, count: int = 1) -> str:
        """Fetch something."""
        return what * count

    get_info = arm.exposed()
'''
WRONG = '''
from robotree.kinds import Arm, Rover
from robotree.vr import Child, Children, VirtualRobot, command


class Wrong(VirtualRobot):
    """Makes one mistake in each marked line."""

    arm = Child(Arm)
    rovers = Children(Rover)

    @command
    def go(self) -> None:
        """Go there."""
        self.arm.go_to(x="far", y=0, z=0, twist=0)  # wrong
        self.arm.go_to(x=0.1, y=0, z=0)  # wrong
        self.arm.no_such()  # wrong
        self.arm.get_info().height  # wrong
        self.arm.grip(action="ajar")  # wrong
        self.arm.go_to.start(x=0.1, y=0, z="up", twist=0)  # wrong
        self.arm.go_to.tell(a=1)  # wrong
        self.arm.go_to(x=0.1, y=0, z=0.1, twist=0, within=[5])  # wrong
        self.arm.go_to(x="far", y=0, z=0.1, twist=0, within="5 s")  # wrong
        self.arm.go_to(x=0.1, y=0, within="5 s")  # wrong
        self.arm.go_to(x=0.1, y=0, z=0.1, twist=0, whithin="5 s")  # wrong
        self.arm.go_to(0.1, 0, 0.1, 0, 0.1, "5 s")  # wrong
        number: str = self.arm.get_info(within="5 s").z  # wrong
        self.arm.get_info.start(within=None, without=2)  # wrong
        word: str = self.arm.get_info.start().result().z  # wrong
        for rover in self.rovers:
            rover.fly()  # wrong
        self.rovers[0].move(x=None, y=0)  # wrong
        with self.together() as both:
            both.start(self.arm.go_to, x="far", y=0, z=0, twist=0)  # wrong
            both.start(self.arm.go_to, x=0.1)  # wrong
            both.start(self.arm.get_info, within=b"5 s")  # wrong
            both.start(self.arm.no_such)  # wrong
            both.start(self.fetch, 3)  # wrong
            word = both.start(self.arm.get_info).result().z  # wrong
            both.start(self.arm.go_to(x=0.1, y=0, z=0.1, twist=0))  # wrong
        with self.first() as race:
            race.start(self.rovers[0].move, x=None, y=0)  # wrong
        print(word, number)

    def fetch(self, what: str) -> str:
        """Fetch something."""
        return what


class NoKind(VirtualRobot):
    """Gives a class that is no interface."""

    arm = Child(int)  # wrong
'''
OWN = '''
from painter_kind import Painter
from robotree.vr import Child, VirtualRobot, command


class Studio(VirtualRobot):
    """Uses the interface that was written from a living robot."""

    painter = Child(Painter)

    @command
    def paint(self) -> int:
        """Paint."""
        self.painter.stroke(heights=[0.1], hand="up")  # wrong
        seen = self.painter.look(within="1 s")
        self.painter.look(within=None, where=1)  # wrong
        nearest: float = seen.nearest  # wrong
        print(nearest, seen.cups[0].at.x + 1)
        return self.painter.follow(points=[])
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of an author's own, with pages."""
    from robotree.vr.author.command import commands_of
    from robotree.vr.author.stubs import interface
    from robotree.vr.base.address import Address
    from robotree.vr.base.description import RobotDescription

    made = tmp_path_factory.mktemp("pages")
    specs = tuple(one.spec for one in commands_of(Painter).values())
    painter = RobotDescription(address=Address("robot", "p", "1"), kinds=Painter.kinds(), commands=specs)
    (made / "painter_kind.py").write_text(interface(painter, origin="Written by a test."))
    with contextlib.chdir(made):
        assert main(["new", "mine", "--over", "arm"]) == 0
    for name, text in (("right", RIGHT), ("wrong", WRONG), ("own", OWN)):
        (made / f"{name}.py").write_text(text)
    return made


def marked(folder: Path) -> set[tuple[str, int]]:
    return {
        (path.name, number)
        for path in folder.glob("*.py")
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if line.endswith("# wrong")
    }


@pytest.fixture(scope="module", autouse=True)
def checkers(folder: Path) -> Iterator[dict[str, subprocess.Popen[str]]]:
    """Both at work, beside each other."""
    venv = {"venvPath": str(TOOLS.parents[1]), "venv": TOOLS.parent.name}
    settings = {"extraPaths": [str(ROOT / "typings")], "typeCheckingMode": "standard", **venv}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings | {"reportUnusedExpression": False}))
    options = ["--strict", "--follow-imports=silent", f"--cache-dir={ROOT / '.mypy_cache'}"]
    commands = {
        "pyright": ["--outputjson"],
        "mypy": [*options, "--no-error-summary", "--no-color-output", "."],
    }
    pipe = subprocess.PIPE
    started = {
        name: subprocess.Popen([str(TOOLS / name), *more], cwd=folder, stdout=pipe, stderr=pipe, text=True)
        for name, more in commands.items()
    }
    yield started
    for one in started.values():
        one.kill()
        one.communicate()


def test_pyright_flags_the_wrong_lines_and_no_others(
    folder: Path, checkers: dict[str, subprocess.Popen[str]]
) -> None:
    found = json.loads(checkers["pyright"].communicate()[0])["generalDiagnostics"]
    places = {(Path(one["file"]).name, one["range"]["start"]["line"] + 1) for one in found}
    assert places == marked(folder), found


def test_mypy_flags_the_wrong_lines_and_no_others(
    folder: Path, checkers: dict[str, subprocess.Popen[str]]
) -> None:
    said = checkers["mypy"].communicate()
    found = re.finditer(r"^(\w+\.py):(\d+): error", said[0], re.MULTILINE)
    assert {(one[1], int(one[2])) for one in found} == marked(folder), said
