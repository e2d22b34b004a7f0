"""A page under `rehearse`: what an author can ask of a fake, and what a fake refuses as a robot does."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robotree import kinds
from robotree.examples.move_to import MoveTo
from robotree.examples.open_close_lever import OpenCloseLever
from robotree.examples.swing_held import HeldMove
from robotree.proxy.arm import Arm
from robotree.proxy.rover import Rover
from robotree.testing import Fake, Page, cell, in_turn, rehearse, watch
from robotree.vr import BadArgument, CommandCancelled, CommandFailed, DeadlineExceeded, SlotEmpty, VrError
from robotree.vr.base.errors import DoesNotFit, NobodyAttends, NoSuchCommand, NotInControl, Stopped, WrongKind
from robotree.vr.core.machine import ATTENTION
from robotree.vr.world.virtual_runner import VirtualRunner
from tests.command_line import ran
from tests.testing.pages import Crowd, Half, Hidden, Hoist, Lift, Spinning, Swallowing, Typed


def test_what_was_commanded_can_be_asserted_on() -> None:
    team = rehearse(Lift, arm=Fake(Arm, get_info={"z": 0.3}))
    assert team.call("lift", height="12 cm") == pytest.approx(0.3)
    assert team.commanded == [
        ("arm", "grip", {"action": "close"}),
        ("arm", "go_to", {"x": 0, "y": 0, "z": 0.42, "twist": 0}),
    ]
    assert team.progress == [(0.0, "gripping"), (0.5, "lifting"), (1.0, "lifted")]


def test_what_wants_a_key_goes_on_while_the_operator_holds_it_and_two_seconds_longer() -> None:
    with rehearse(HeldMove, arm=Fake(Arm)) as team:
        with pytest.raises(NobodyAttends):
            team.call("swing")
        with team.holding():
            going = team.start("swing")
            team.wait(5 * ATTENTION)
            assert not going.done
        let_go = team.now
        with pytest.raises(CommandCancelled):
            going.result()
        assert team.now - let_go == pytest.approx(ATTENTION, abs=0.3)


@pytest.mark.speed
def test_a_rehearsal_takes_no_time() -> None:
    rehearse(Lift, arm=Fake(Arm)).close()
    began = time.process_time()
    with rehearse(Lift, arm=Fake(Arm, takes=30.0)) as team:
        team.call("lift", within=100)
    assert team.now > 60
    assert time.process_time() - began < 0.1


def test_a_fake_remembers_what_it_was_commanded() -> None:
    with rehearse(Lift, arm=Fake(Arm)) as team:
        height = team.call("lift", height=0.2)
        assert height == pytest.approx(0.025 + 0.2)
        assert team.call("get_info").z == height
        assert team.describe("arm").readings["z"] == height


def test_results_can_be_a_value_a_function_or_a_sequence() -> None:
    def lowered(**_: Any) -> dict[str, float]:
        return {"z": 0.2}

    for canned, expected in (
        ({"z": 0.1}, [0.1, 0.1]),
        (lowered, [0.2, 0.2]),
        (in_turn({"z": 0.1}, {"z": 0.1}, {"z": 0.4}), [0.1, 0.4]),
    ):
        with rehearse(Lift, arm=Fake(Arm, get_info=canned)) as team:
            assert [team.call("lift", height=0.1), team.call("lift", height=0.1)] == expected


def test_a_function_sees_the_arguments_and_its_own_mistake_is_raised_in_the_test() -> None:
    speeds: list[float] = []

    def go_to(x: float, speed: float) -> None:
        assert x == 0
        speeds.append(speed)

    with rehearse(Lift, arm=Fake(Arm, go_to=go_to)) as team:
        team.call("lift")
        assert speeds == [0.15]

    def wrong(x: float) -> None:
        assert x == 7

    team = rehearse(Lift, arm=Fake(Arm, go_to=wrong))
    with pytest.raises(AssertionError, match="assert"):
        team.call("lift")


def test_settings_are_given_as_create_takes_them_and_can_be_changed() -> None:
    with rehearse(Lift, arm=Fake(Arm), settings={"speed": "20 cm/s"}) as team:
        team.call("rise")
        team.call("set", speed=0.05)
        team.call("rise")
        assert [arguments["speed"] for _, _, arguments in team.commanded] == [0.2, 0.05]
    with pytest.raises(BadArgument, match="speed"):
        rehearse(Lift, arm=Fake(Arm), settings={"speed": 3})


def test_a_slot_for_several_takes_a_list_of_fakes() -> None:
    with rehearse(Crowd, arms=[Fake(Arm), Fake(Arm).lose("hold"), Fake(Arm)]) as team:
        assert team.call("hold") == 2
        assert team.commanded.names == ["arms[0].hold", "arms[1].hold", "arms[2].hold"]
        team.fill("arms[1]", Fake(Arm))
        assert team.call("hold") == 3


def test_a_fake_refuses_what_its_kind_refuses() -> None:
    with rehearse(Lift, arm=Fake(Arm)) as team:
        with pytest.raises(
            BadArgument, match=r"x: 5 m is out of range; give a number in m from -0.65 to 0.65"
        ):
            team.call("go_too_far")
        with pytest.raises(BadArgument, match=r"height: .*kg"):
            team.call("lift", height="3 kg")
        with pytest.raises(NoSuchCommand):
            team.call("fly")
        assert team.commanded == []


def test_a_fake_obeys_its_parent_alone() -> None:
    with rehearse(Lift, arm=Fake(Arm)) as team, pytest.raises(NotInControl):
        team.call_robot("arm", "grip", action="open")


def test_a_slot_takes_only_a_fake_of_its_kind() -> None:
    with pytest.raises(WrongKind):
        rehearse(Lift, arm=Fake(Rover))
    with pytest.raises(TypeError, match="Lift has no child slot 'arms'; it has: arm"):
        rehearse(Lift, arms=Fake(Arm))
    with pytest.raises(TypeError, match=r"arm: 3 cannot be in a slot; give Fake\(KIND\)"):
        rehearse(Lift, arm=3)  # type: ignore[arg-type] # that is the mistake


def test_a_result_that_the_kind_could_not_give_is_refused() -> None:
    with pytest.raises(ValueError, match="the result of get_info has no part 'height'; it has: busy, fx"):
        Fake(Arm, get_info={"height": 0.3})
    with pytest.raises(ValueError, match="Arm has no command 'lift'; it has"):
        Fake(Arm, lift=3)
    with rehearse(Lift, arm=Fake(Arm, get_info={"z": "high"})) as team, pytest.raises(VrError, match="high"):
        team.call("lift")


def test_a_page_that_makes_a_mistake_shows_its_own_error() -> None:
    with rehearse(Lift, arm=Fake(Arm)) as team:
        with pytest.raises(CommandFailed, match=r"KeyError: 'shelf' \(pages.py, line") as caught:
            team.call("stumble")
        cause = caught.value.__cause__
        assert isinstance(cause, KeyError)
        assert cause.__traceback__ is not None


def test_a_page_can_be_the_child_of_a_page() -> None:
    with rehearse(Hoist, lift=Page(Lift, arm=Fake(Arm))) as team:
        assert team.call("twice", height="10 cm") == pytest.approx(0.225)
        assert team.commanded.of("lift").names == ["lift.lift"] * 2
        assert team.commanded.of("lift.arm").names == ["lift.arm.grip", "lift.arm.go_to"] * 2


def test_a_page_can_be_named_by_its_file(tmp_path: Path) -> None:
    page = tmp_path / "wave.py"
    page.write_text(
        "from robotree.vr import Child, VirtualRobot, command\n"
        "class Wave(VirtualRobot):\n"
        "    arm = Child('Arm')\n"
        "    @command\n"
        "    def wave(self) -> None:\n"
        "        self.arm.hold()\n"
    )
    with rehearse(page, arm=Fake(Arm)) as team:
        team.call("wave")
        assert team.commanded == [("arm", "hold", {})]


def test_a_kind_can_be_an_interface_and_a_slot_with_it_takes_the_fake() -> None:
    with rehearse(Typed, arm=Fake(kinds.Arm, get_info={"z": 0.3})) as team:
        assert team.call("height") == 0.3
    with pytest.raises(DoesNotFit, match="has no command halt"):
        rehearse(Typed, arm=Fake(Half))


def test_a_page_can_be_faked_with_the_commands_that_it_lets_through() -> None:
    mover = Fake(MoveTo, takes=0.1, get_info={"width": 0.03})
    with rehearse(OpenCloseLever, mover=mover) as team:
        team.call("close")
        assert set(team.commanded.names) == {"mover.grip", "mover.move"}
    with pytest.raises(TypeError, match=r"Hidden\.show is a command of its Ghost, which is not known here"):
        Fake(Hidden)


async def test_a_rehearsal_refuses_to_run_inside_an_event_loop() -> None:
    with pytest.raises(RuntimeError, match="make the test a plain function"):
        rehearse(Lift, arm=Fake(Arm))


def test_a_kind_can_be_a_description_of_a_living_robot(tmp_path: Path) -> None:
    with rehearse(Lift, arm=Fake(Arm)) as team:
        description = team.describe("arm")
    path = tmp_path / "arm.json"
    path.write_bytes(msgspec.json.encode(description))
    for source in (description, path):
        with rehearse(Lift, arm=Fake(source, get_info={"z": 0.3})) as team:
            assert team.call("lift") == 0.3
            with pytest.raises(BadArgument):
                team.call("go_too_far")


# -- faults ----------------------------------------------------------------------------------------


def test_a_child_can_refuse_at_a_call() -> None:
    arm = Fake(Arm).refuse("go_to", at=2, why="the way is blocked")
    with rehearse(Lift, arm=arm) as team:
        team.call("lift")
        with pytest.raises(CommandFailed, match="the way is blocked"):
            team.call("lift")
        team.call("lift")


def test_a_child_can_be_late() -> None:
    with rehearse(Lift, arm=Fake(Arm).delay("go_to", by=50.0)) as team:
        with pytest.raises(DeadlineExceeded):
            team.call("lift", within=10)
        assert team.now < 12


def test_a_child_can_be_lost_at_a_step() -> None:
    with rehearse(Lift, arm=Fake(Arm).lose("go_to", after=0.4)) as team:
        with pytest.raises(SlotEmpty):
            team.call("lift")
        assert not team.page.child_slots["arm"].bond
        team.fill("arm", Fake(Arm))
        team.call("lift")


def test_a_child_that_stands_still_for_a_moment_is_waited_for() -> None:
    with rehearse(Lift, arm=Fake(Arm).freeze("go_to", lasts=0.5)) as team:
        team.call("lift")
        assert team.now > 2.5


def test_an_operator_can_cancel_at_a_step() -> None:
    with rehearse(Lift, arm=Fake(Arm, takes=2.0)) as team:
        team.cancel(at=2, after=0.5)
        with pytest.raises(CommandCancelled):
            team.call("lift")
        team.wait(1.0)
        assert [(step.command, step.error) for step in team.steps if step.robot and not step.reads] == [
            ("grip", ""),
            ("go_to", "CommandCancelled"),
        ]


def test_a_stop_ends_the_command_and_holds_until_it_is_released() -> None:
    with rehearse(Lift, arm=Fake(Arm).stop("grip", after=0.2)) as team:
        with pytest.raises(CommandCancelled):
            team.call("lift")
        with pytest.raises(Stopped):
            team.call("lift")
        team.resume()
        team.call("lift")


def test_time_can_be_let_pass_by_hand() -> None:
    with rehearse(Lift, arm=Fake(Arm)) as team:
        going = team.start("lift")
        team.wait(1.5)
        assert not going.done
        assert team.commanded.names == ["arm.grip", "arm.go_to"]
        team.cancel()
        with pytest.raises(CommandCancelled):
            going.result()


def test_a_page_that_ignores_every_interruption_is_abandoned() -> None:
    with rehearse(Swallowing, arm=Fake(Arm, takes=100.0)) as team:
        team.cancel(after=1.0)
        with pytest.raises(CommandCancelled):
            team.call("lift", within=300)
        assert team.describe().abandoned == ("lift",)


def test_a_page_that_computes_without_waiting_is_ended_with_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "LIMIT", 0.3)
    with (
        rehearse(Spinning, arm=Fake(Arm).lose("grip")) as team,
        pytest.raises(RuntimeError, match=r"spinning computes without waiting for 0.3 s") as caught,
    ):
        team.call("lift")
    assert ".py" in str(caught.value)


def test_code_that_holds_a_lock_is_interrupted_when_it_has_left_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "LIMIT", 0.1)
    runner = VirtualRunner()

    def compute(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            pass

    with watch.watched(runner):
        with runner.lock():
            compute(0.3)
        with pytest.raises(watch.Endless):
            compute(60.0)
    assert not runner.holding


def test_the_same_seed_gives_the_same_story() -> None:
    def story(seed: int) -> str:
        with rehearse(Lift, arm=Fake(Arm).lose("go_to", after=0.3), seed=seed) as team:
            with pytest.raises(VrError):
                team.call("lift")
            return team.world.digest

    assert story(3) == story(3)
    assert story(3) != story(4)


def test_a_fault_of_a_command_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ValueError, match="there is no command 'lift' to refuse"):
        Fake(Arm).refuse("lift")


# -- the simulated arm: real physics, firmware and proxy, faster than real time --------------------


FASTER = 5.0
"""Virtual time by processor time that authors are promised; it is about 15 on a machine of 2026."""


@pytest.mark.speed
def test_a_lever_is_closed_by_the_simulated_arm_faster_than_real_time() -> None:
    began = time.process_time()
    with rehearse(OpenCloseLever, mover=Page(MoveTo, arm=cell("arm"))) as team:
        force = team.call("close", within=120)
        assert 0 < force < 40
        assert team["mover.arm"].world.lever_angle == pytest.approx(0.785, abs=0.02)
        assert team.now > FASTER * (time.process_time() - began)


def test_a_cable_that_is_cut_fails_the_command_and_is_found_again() -> None:
    arm = cell("arm")
    with rehearse(MoveTo, arm=arm) as team:
        team.call("go_to", x=0.4, y=0, z=0.3, twist=0)
        going = team.start("go_to", x=0.4, y=0.2, z=0.3, twist=0)
        team.wait(0.3)
        arm.cut()
        with pytest.raises(CommandFailed):
            going.result()
        arm.mend()
        team.wait(3.0)
        team.call("go_to", x=0.4, y=0.2, z=0.3, twist=0)
        assert team.call("get_info").y == pytest.approx(0.2, abs=0.005)


def test_a_stop_stops_the_simulated_arm() -> None:
    with rehearse(MoveTo, arm=cell("arm")) as team:
        going = team.start("go_to", x=0.4, y=0.3, z=0.3, twist=0)
        team.wait(0.5)
        team.stop()
        assert going.done
        where = team.call("get_info").y
        team.wait(1.0)
        assert team.call("get_info").y == pytest.approx(where, abs=0.002)
        with pytest.raises(Stopped):
            team.call("go_to", x=0.4, y=0, z=0.3, twist=0)


def test_a_kind_that_cannot_be_simulated_alone_is_refused() -> None:
    with pytest.raises(ValueError, match="there is no simulated robot 'leg'; there is: arm, rover"):
        cell("leg")


# -- the plug-in of pytest, in a run of its own ----------------------------------------------------


TESTS = """
from robotree.proxy.arm import Arm
from robotree.testing import Fake, rehearse, rehearse_seeds
from robotree.vr import Child, VirtualRobot, command

class Nod(VirtualRobot):
    arm = Child("Arm")

    @command
    def nod(self) -> None:
        self.arm.grip(action="open")
        self.arm.go_to(x=0.3, y=0.0, z=0.2, twist=0.0)

def test_that_passes() -> None:
    team = rehearse(Nod, arm=Fake(Arm))
    team.call("nod")
    assert team.commanded.names == ["arm.grip", "arm.go_to"]

def test_that_fails() -> None:
    team = rehearse(Nod, arm=Fake(Arm))
    team.call("nod")
    assert team.commanded == [
        ("arm", "grip", {"action": "open"}),
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.25, "twist": 0}),
    ]

def test_that_nothing_is_left_open() -> None:
    from robotree.testing.team import unended
    assert unended() == []

def test_under_seeds() -> None:
    rehearse_seeds(Nod, "nod", arm=Fake(Arm), seeds=5, check=note_seed)

def note_seed(team):
    with open("seeds", "a") as file:
        print(team.world.seed, file=file)
"""


def test_a_failing_test_shows_the_difference_and_the_story_and_the_command_line_chooses_the_seed(
    tmp_path: Path,
) -> None:
    (tmp_path / "test_nod.py").write_text(TESTS)
    options = ("-q", "-p", "no:cacheprovider", "--robotree-seed", "4321")
    done = ran([sys.executable, "-m", "pytest", *options, str(tmp_path)], cwd=tmp_path)
    output = done.stdout + done.stderr
    assert "3 passed" in output
    assert "1 failed" in output
    assert "= arm.grip(action='open')" in output
    assert "- arm.go_to(x=0.3, y=0, z=0.25, twist=0)" in output
    assert "+ arm.go_to(x=0.3, y=0, z=0.2, twist=0)" in output
    assert "rehearsal 1: what was commanded" in output
    assert "1.124 s  arm.go_to(x=0.3, y=0, z=0.2, twist=0)" in output
    assert (tmp_path / "seeds").read_text() == "0\n4321\n"  # the usual play, then the chosen one


def test_a_type_checker_reads_the_kit() -> None:
    import robotree.testing

    assert Path(robotree.testing.__file__).with_name("py.typed").exists()
