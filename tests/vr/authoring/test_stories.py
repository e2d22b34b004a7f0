"""What authors do, written as a student would write it; one test for each story.

Most stories have tests of their own beside what they are about: `TOLD_ELSEWHERE` names one for each, and a
test looks that it is there. The stories of this file are those that had none.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Annotated

import pytest

from robotree.kinds import Arm, Rover
from robotree.testing import Fake, Page, in_turn, rehearse, rehearse_seeds
from robotree.vr import (
    BadArgument,
    Child,
    ChildCancelled,
    Children,
    CommandCancelled,
    Failed,
    Range,
    SlotEmpty,
    Unit,
    VirtualRobot,
    command,
)

ROOT = Path(__file__).parents[3]
TOLD_ELSEWHERE = {
    "rovers in an array, and one is lost": "tests/vr/authoring/test_an_array_of_children.py::"
    "test_a_lost_rover_leaves_a_gap_that_can_be_filled_again",
    "a list of Child": "tests/vr/authoring/test_an_array_of_children.py::"
    "test_a_list_of_child_is_refused_with_what_to_write",
    "two arms at the same time": "tests/vr/core/test_together.py::"
    "test_two_arms_move_at_the_same_time_and_the_block_waits_for_both",
    "the first that succeeds": "tests/vr/core/test_together.py::"
    "test_the_first_that_succeeds_wins_and_the_others_are_cancelled",
    "a started move ends with its command": "tests/vr/core/test_cleanup.py::"
    "test_what_a_command_has_started_ends_with_it",
    "a detached move goes on": "tests/vr/core/test_cleanup.py::test_what_is_detached_goes_on",
    "let go after a cancel": "tests/examples/test_pick_and_place.py::"
    "test_it_lets_go_when_it_is_cancelled_or_late",
    "nothing moves after a stop": "tests/examples/test_pick_and_place.py::test_nothing_moves_after_a_stop",
    "an empty shelf": "tests/vr/core/test_failing.py::test_a_parent_catches_a_failure_and_reads_its_values",
    "a cause is kept": "tests/vr/core/test_failing.py::test_a_failure_keeps_its_cause",
    "wrong arguments to a child": "tests/vr/core/test_failing.py::"
    "test_wrong_arguments_for_a_child_name_the_line_of_the_page",
    "three ways to lose a call": "tests/vr/core/test_failing.py::"
    "test_three_things_that_end_a_call_of_a_child_say_which_they_are",
    "numpy": "tests/vr/authoring/test_values.py::test_numpy_goes_to_a_child_and_back",
    "a small picture": "tests/vr/authoring/test_values.py::test_a_picture_is_saved_from_the_command_line",
    "Unit('metrs')": "tests/vr/authoring/test_values.py::test_an_unknown_unit_names_the_nearest",
    "a setting is changed": "tests/vr/core/test_fields.py::test_a_setting_is_changed_while_a_command_runs",
    "state is kept": "tests/vr/core/test_fields.py::"
    "test_what_a_command_changes_inside_a_list_is_kept_when_it_ends",
    "a page is reloaded": "tests/vr/network/test_reload.py::test_bonds_settings_and_state_stay",
    "a syntax error leaves the old page": "tests/vr/network/test_reload.py::"
    "test_a_page_with_a_mistake_leaves_the_old_one_running",
    "a test with a fake": "tests/testing/test_rehearse.py::test_what_was_commanded_can_be_asserted_on",
    "a test with physics": "tests/testing/test_simulated.py::"
    "test_a_lever_is_closed_by_the_simulated_arm_faster_than_real_time",
    "a test under 100 seeds": "tests/testing/test_seeds.py::"
    "test_a_good_page_keeps_the_laws_under_100_seeds_in_two_seconds_of_processor_time",
    "an own class of the same name": "tests/vr/authoring/test_kinds.py::"
    "test_an_own_class_of_the_same_name_does_not_fit_an_arm_slot",
    "pyright": "tests/vr/authoring/test_type_checkers.py::test_pyright_flags_the_wrong_lines_and_no_others",
    "mypy": "tests/vr/authoring/test_type_checkers.py::test_mypy_flags_the_wrong_lines_and_no_others",
    "pages with mistakes": "tests/vr/authoring/test_mistakes.py::"
    "test_a_page_with_a_mistake_is_refused_with_its_line_and_the_remedy",
    "a page of several files": "tests/vr/authoring/test_helpers.py::"
    "test_a_page_imports_what_lies_beside_it_in_every_usual_way",
    "an edited helper": "tests/vr/authoring/test_helpers.py::test_an_edited_helper_is_never_stale",
    "a thread pool": "tests/vr/core/test_thread_pools.py::"
    "test_a_thread_pool_works_for_the_command_with_keys_that_repeat",
    "units on the way": "tests/vr/core/test_exposed_units.py::"
    "test_arguments_and_results_are_converted_on_the_way",
    "six steps": "tests/vr/core/test_progress.py::test_each_of_six_quick_steps_is_told",
    "print": "tests/vr/network/test_logs_of_robots.py::"
    "test_print_logging_and_warnings_are_in_the_robots_own_log",
    "check": "tests/tui/test_authoring.py::test_check_prints_file_line_and_what_to_write",
    "new": "tests/tui/test_authoring.py::test_a_new_page_passes_its_check_and_nothing_is_overwritten",
    "an installed wheel": "tests/architecture/test_wheel.py::"
    "test_an_author_tests_a_page_of_the_guide_in_an_empty_folder",
    "the guide": "tests/guide/test_guide.py::test_a_chapter_is_played",
}
Metres = Annotated[float, Unit("m"), Range(0, 1)]


@pytest.mark.parametrize("story", TOLD_ELSEWHERE)
def test_a_story_that_is_told_elsewhere_is_told(story: str) -> None:
    file, _, name = TOLD_ELSEWHERE[story].partition("::")
    functions = ast.walk(ast.parse((ROOT / file).read_text()))
    assert name in {
        function.name
        for function in functions
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
    }


# -- an optional child -----------------------------------------------------------------------------


class Watchful(VirtualRobot):
    """An arm that asks a rover whether the way is free, if there is one."""

    arm = Child("Arm")
    guard = Child("Rover", optional=True)

    @command
    def reach(self) -> str:
        """Go there, and say who looked."""
        seen = "nobody looked"
        if self.guard:
            seen = f"it stands at {self.guard.get_info().x:g}"
        self.arm.go_to(x=0.3, y=0, z=0.3, twist=0)
        return seen


def test_a_robot_works_without_its_optional_child_and_with_it() -> None:
    with rehearse(Watchful, arm=Fake(Arm)) as team:
        assert team.call("reach") == "nobody looked"
        team.fill("guard", Fake(Rover, get_info={"x": 2.0}))
        assert team.call("reach") == "it stands at 2"


# -- a thesis' array -------------------------------------------------------------------------------


class Convoy(VirtualRobot):
    """Rovers that drive one after the other; one that is lost is left behind."""

    rovers = Children("Rover", least=2, most=4)

    @command
    def drive(self, x: Metres) -> list[int]:
        """Drive; tell which arrived."""
        arrived: list[int] = []
        for index, rover in self.rovers.items():
            try:
                rover.move(x=x, y=0)
            except SlotEmpty:
                continue
            arrived.append(index)
        return arrived


def test_a_convoy_goes_on_without_the_rover_that_it_loses() -> None:
    rovers = [Fake(Rover), Fake(Rover).lose("move", after=0.5), Fake(Rover)]
    with rehearse(Convoy, rovers=rovers) as team:
        assert team.call("drive", x="50 cm") == [0, 2]
        assert team.call("drive", x=0.5) == [0, 2]
        team.fill("rovers[1]", Fake(Rover))
        assert team.call("drive", x=0.5) == [0, 1, 2]


def test_a_convoy_keeps_the_laws_whatever_goes_wrong() -> None:
    rehearse_seeds(Convoy, "drive", {"x": 0.5}, rovers=[Fake(Rover), Fake(Rover)], seeds=30)


# -- trying again ----------------------------------------------------------------------------------


class Patient(VirtualRobot):
    """Tries three times, and says how often."""

    arm = Child("Arm")

    @command
    def take(self) -> int:
        """Grip until something is in the hand."""
        for attempt in (1, 2, 3):
            self.progress(attempt / 3, f"attempt {attempt}")
            self.arm.grip(action="close")
            if self.arm.get_info().holding:
                return attempt
            self.arm.grip(action="open")
            self.sleep(60)
        raise Failed("it slips out of the hand", attempts=3)


def test_a_robot_that_waits_a_minute_between_attempts_is_tested_in_a_moment() -> None:
    arm = Fake(Arm, get_info=in_turn({"holding": False}, {"holding": True}))
    with rehearse(Patient, arm=arm) as team:
        assert team.call("take", within=300) == 2
        assert team.now > 60
        assert team.progress == [(1 / 3, "attempt 1"), (2 / 3, "attempt 2")]


def test_a_failure_tells_its_values_to_the_parent() -> None:
    with rehearse(Patient, arm=Fake(Arm)) as team:
        with pytest.raises(Failed) as caught:
            team.call("take", within=300)
        assert caught.value.attempts == 3


def test_a_wait_ends_at_once_when_it_is_cancelled() -> None:
    with rehearse(Patient, arm=Fake(Arm)) as team:
        team.cancel(after=10.0)
        with pytest.raises(CommandCancelled):
            team.call("take", within=300)
        assert team.now < 11


# -- somebody else's cancel ------------------------------------------------------------------------


class Shared(VirtualRobot):
    """Goes on when somebody cancels the arm alone."""

    arm = Child("Arm")

    @command
    def go(self) -> str:
        """Go, and say what happened."""
        try:
            self.arm.go_to(x=0.3, y=0, z=0.3, twist=0)
        except ChildCancelled:
            return "somebody has cancelled the arm"
        return "there"


def test_an_arm_that_fails_by_a_cancel_of_its_own_does_not_end_the_page() -> None:
    cancelled = CommandCancelled(robot="arm", command="go_to", reason="by hand")
    with rehearse(Shared, arm=Fake(Arm, go_to=cancelled)) as team:
        assert team.call("go") == "somebody has cancelled the arm"


class Choosy(VirtualRobot):
    """Refuses, or has the arm refuse."""

    arm = Child("Arm")

    @command
    def take(self, x: float) -> None:
        """Take what is near."""
        if x > 1.0:
            raise BadArgument(command="take", parameter="x", reason="is too far")
        self.arm.go_to(x=x, y=0, z=-9.0, twist=0)


def test_only_what_a_child_refuses_names_the_line_of_the_page() -> None:
    with rehearse(Choosy, arm=Fake(Arm)) as team:
        with pytest.raises(BadArgument) as own:
            team.call("take", x=2.0)
        assert str(own.value).endswith("is too far")
        with pytest.raises(BadArgument, match=r"\(test_stories\.py, line \d+\)$"):
            team.call("take", x=0.3)


# -- pages on pages --------------------------------------------------------------------------------


class Twice(VirtualRobot):
    """Drives a convoy twice, and lets the arm be moved from above."""

    convoy = Child("Convoy")
    arm = Child("Arm")

    @command
    def there_and_back(self, x: Metres) -> int:
        """Drive twice; tell how many arrived in all."""
        return sum(len(self.convoy.drive(x=x)) for _ in range(2))

    grip = arm.exposed()
    where = arm.exposed("get_info")


def test_a_page_commands_a_page_and_lets_a_command_through_under_another_name() -> None:
    convoy = Page(Convoy, rovers=[Fake(Rover), Fake(Rover)])
    with rehearse(Twice, convoy=convoy, arm=Fake(Arm, get_info={"z": 0.2})) as team:
        assert team.call("there_and_back", x="1 m") == 4
        assert team.call("where").z == 0.2
        team.call("grip", action="width", width="3 cm")
        assert team.commanded[-1] == ("arm", "grip", {"action": "width", "width": 0.03})
        with pytest.raises(BadArgument, match="width"):
            team.call("grip", action="width", width="3 kg")
