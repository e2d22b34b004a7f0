"""What pages do beside plain calls goes on after a kill, too: groups, races, clean-ups, waits, refusals.

Each page is rehearsed in virtual time and killed once for each moment of each step: when a child has
accepted it, while it is carried out, and just behind its end; or an old copy of its disk is put back. A
command that was paused is still paused afterwards, and takes single steps. What needs real processes comes
last; a plain tour is killed at each boundary of the journal in test_campaign.py.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Iterator
from typing import Any

import pytest

from robotree.examples.smooth_move import SmoothMove
from robotree.sim.firmware.movement import Job, Movement
from robotree.testing import Page, cell, parts, rehearse
from robotree.testing.parts import Part
from robotree.testing.team import Going, Team
from robotree.vr import Robot, command
from robotree.vr.base.errors import CommandCancelled, CommandInDoubt, NotConfirmed, VrError
from robotree.vr.exchange.client import RobotClient
from tests.durability.pages import Helper, Patrol
from tests.durability.stage import COMPLAINT, PAGES, Stage

STEPS = 6
"""Of a tour that is paused."""
MOMENTS = (0.0, 0.01, 0.0231, 0.06)
"""[s] behind the moment at which a child accepts a step, which takes 0.02 s and the way back."""


class Arm(Robot):
    """Counts what it does."""

    done = 0

    def readings(self) -> dict[str, float]:
        return {"done": float(self.done)}

    @command
    def act(self, n: int, seconds: float = 0.0) -> int:
        """Do one thing, which takes its time."""
        self.sleep(seconds or 0.02)
        self.done += 1
        return n * 2


class Arms(Part):
    """An arm in a process of its own."""

    def enter(self, team: parts.Stage, path: str, name: str) -> None:
        team.start_robot(path, Arm(name))


def tourist() -> Team:
    return rehearse(f"{PAGES}:Tourist", arm=Arms(), helper=Page(Helper, arm=Arms()))


def patrol() -> Team:
    return rehearse(Patrol, arm=Arms())


def begun(team: Team) -> list[int]:
    """Return the numbers of all that the arms have begun, in order; none under the same key as another."""
    steps = [step for step in team.steps if step.robot.endswith("arm")]
    assert len({step.key for step in steps}) == len(steps)
    return [step.arguments["n"] for step in steps]


def acts(team: Team) -> list[int]:
    """Return these numbers sorted."""
    return sorted(begun(team))


def killed(make: Any, command: str, steps: int, *, second: bool = False) -> Iterator[tuple[Any, Team]]:
    """Yield the result and the team of a command that is killed at each moment of each step."""
    with make() as calm:
        calm.call(command, steps=steps)
        calm.wait(1.0)
        numbers = acts(calm)
        count = sum(step.robot != "" for step in calm.steps)
    for at in range(1, count + 1):
        for after in MOMENTS:
            with make() as team:
                team.crash(at=at, after=after)
                if second:
                    team.crash(at=at + 2, after=after)
                result = team.call(command, steps=steps)
                team.wait(2.0)
                assert "is started again" in team.story()
                assert acts(team) == numbers, f"killed {after} s behind step {at}"
                yield result, team


@pytest.mark.parametrize(
    ("command", "steps", "result"),
    [
        ("pairs", 4, [0, 2, 4, 6]),
        ("parts", 2, 2 * sum(range(4))),
        ("watch", 2, [1.0, 2.0]),
        ("telling", 2, 2),
        ("mending", 2, ["BadArgument"] * 2),
        ("rounds", 2, 2),
    ],
)
def test_wherever_it_is_killed_a_page_does_all_once_and_says_what_it_would_have_said(
    command: str, steps: int, result: Any
) -> None:
    """Parts and functions at once; readings that are waited for; what is told, caught, or needed no more."""
    assert [found for found, _ in killed(tourist, command, steps) if found != result] == []


@pytest.mark.parametrize(("command", "steps", "result"), [("rounds", 3, [0, 1, 2]), ("nested", 2, 6)])
def test_after_a_checkpoint_no_step_since_it_is_taken_twice(command: str, steps: int, result: Any) -> None:
    """What a page has changed in place is kept at each checkpoint; rounds may stand in rounds."""
    assert [found for found, _ in killed(patrol, command, steps, second=True) if found != result] == []


def test_a_race_has_the_winner_that_it_had() -> None:
    for winners, team in killed(tourist, "races", 4):
        assert winners == team.call("winners")


@pytest.mark.parametrize("after", [0.01, 0.03, 0.07, 0.1])
def test_a_command_that_was_cancelled_ends_by_its_clean_up(after: float) -> None:
    """The kill comes when the cancel comes, before the clean-up has begun, or in the middle of it."""
    team = tourist()
    team.cancel(at=3)
    team.crash(at=3, after=after)
    with pytest.raises(CommandCancelled):
        team.call("careful", steps=8)
    assert acts(team) == [0, 1, 2, 100, 101, 102, 103]


def test_a_setting_that_is_changed_in_the_middle_is_read_as_it_was() -> None:
    team = tourist()
    call = team.start("paced", steps=8)
    team.wait_until(lambda: len(acts(team)) == 3)
    team.call("set", pace=0.5)
    team.wait_until(lambda: len(acts(team)) == 5)
    team.crash()
    assert call.result() == [0.0] * 3 + [0.5] * 5
    assert acts(team) == list(range(8))


@pytest.mark.parametrize(("at", "after"), [(1, 0.0), (3, 0.1), (3, 0.18), (6, 0.24)])
def test_points_that_an_arm_passes_with_a_blend_are_each_begun_once(
    at: int, after: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kill comes when the arm is sent to a point, on the way, when it passes, or is looked at.

    Nobody sends it to the next point for a second, so it comes to stand at the one that it has only to pass.
    """
    begun: list[object] = []
    begin = Movement.begin

    def count(self: Movement, job: Job, *rest: Any) -> Any:
        begun.append(job.key)
        return begin(self, job, *rest)

    monkeypatch.setattr(Movement, "begin", count)
    arm = cell("arm")
    with rehearse(SmoothMove, arm=arm) as team:
        team.crash(at=at, after=after)
        y = float(arm.world.arm.state().position[1])
        assert team.call("sweep", steps=6, length=0.06, within=60.0) > 1.0
        assert "is started again" in team.story()
        sent = [step for step in team.steps if step.command == "go_to"]
        assert [round(step.arguments["y"] - y, 3) for step in sent] == [0.01, 0.02, 0.03, 0.04, 0.05, 0.06]
        assert len({step.key for step in sent}) == len(set(begun)) == len(begun) == 6, "by the firmware, too"
        assert arm.world.arm.state().position[1] == pytest.approx(y + 0.06, abs=0.004)


def test_an_order_to_the_parent_is_obeyed_when_it_is_back() -> None:
    team = tourist()
    call = team.start("tour", steps=1000)
    team.wait_until(lambda: len(acts(team)) == 3)
    team.crash()
    team.cancel()
    with pytest.raises(CommandCancelled):
        call.result()


def put_back(team: Team, folder: Any) -> None:
    """Kill the page, and start it again with an older state of its disk."""
    team.crash(after=0.0, away=1.0)
    team.wait(0.5)
    team._homes[""]._medium.put_back(folder)
    team.wait_until(lambda: "" in team._agents, within=60.0)


def test_a_command_whose_old_folder_was_put_back_ends_and_nothing_is_done_twice(
    caplog: pytest.LogCaptureFixture,
) -> None:
    team = tourist()
    call = team.start("tour", steps=400, pause=0.01, within=60.0)
    team.wait_until(lambda: len(acts(team)) > 5)
    old = team._homes[""]._medium.copy()
    for lives in (1, 2):
        team.crash()
        team.wait_until(lambda lives=lives: len(acts(team)) > 5 + 5 * lives)
    acted = len(acts(team))
    put_back(team, old)
    with pytest.raises(VrError):
        call.result()
    assert len(acts(team)) <= acted + 1, "but for what was under way"
    assert sorted(set(acts(team))) == acts(team), "nothing is done twice"
    assert not COMPLAINT.search(caplog.text), caplog.text
    assert "was commanded by start 3 of the host of tourist, and this is start 2: an old" in caplog.text


def test_a_person_binds_the_children_of_an_old_folder_again_and_all_goes_on() -> None:
    team = tourist()
    assert team.call("tour", steps=4) == [4.0, 4.0]
    old = team._homes[""]._medium.copy()
    team.crash()
    assert team.call("tour", steps=4) == [8.0, 8.0]
    put_back(team, old)
    for child in ("arm", "helper"):
        team.wait_until(lambda child=child: team.describe(child).bond is None, within=60.0)
        team._do(lambda child=child: team._client().enslave(child, team._agents[child].address))
    before = len(acts(team))
    assert team.call("tour", steps=4) == [8.0, 8.0]
    assert len(acts(team)) == before + 4


def ordered(team: Team, order: Any) -> str:
    """Give an order to the tourist as an operator does; returns what it says."""
    client: RobotClient = team._client()
    return str(team._do(lambda: order(client)))


def paused(team: Team) -> tuple[Going, str]:
    """Begin a tour, pause it in the middle; return it, and the step before which it is."""
    tour = team.start("tour", steps=STEPS, pause=0.05, within=240.0)
    team.wait_until(lambda: bool(begun(team)))
    ordered(team, RobotClient.pause)
    return tour, held(team)


def held(team: Team, path: str = "") -> str:
    """Wait until a robot is before a step; return it in words."""
    team.wait_until(lambda: path in team._agents and bool(team.describe(path).held), 60.0)
    robot = team.describe(path)
    assert robot.paused
    return robot.held


def test_a_killed_host_comes_back_paused_before_the_same_step_and_shows_its_line() -> None:
    team = tourist()
    tour, before = paused(team)
    line = PAGES.read_text().splitlines()[int(before.rpartition(", line ")[2]) - 1]
    assert "sleep" in before
    assert line.strip() == "self.sleep(pause)"
    done = begun(team)
    for _ in range(2):
        team.crash()
        assert held(team) == before
    team.wait(5.0)
    assert begun(team) == done
    assert ordered(team, RobotClient.step) == f"tourist takes {before}"
    held(team)
    assert len(begun(team)) <= len(done) + 1
    ordered(team, RobotClient.go_on)
    assert tour.result() == [STEPS, STEPS]
    assert begun(team) == list(range(STEPS))


def test_a_cancel_of_a_paused_command_is_obeyed_after_a_kill() -> None:
    team = tourist()
    tour, _ = paused(team)
    done = begun(team)
    team.crash()
    held(team)
    team.cancel()
    with pytest.raises(CommandCancelled):
        tour.result()
    assert begun(team) == done


def test_a_command_of_a_child_in_another_process_is_paused_and_outlives_both() -> None:
    """Each of both is killed while the helper is before its step."""
    team = tourist()
    tour, _ = paused(team)
    while "helper.act" not in held(team):
        ordered(team, RobotClient.step)
        team.wait(1.0)
    ordered(team, RobotClient.step)
    before, done = held(team, "helper"), begun(team)
    for path in ("helper", ""):
        team.crash(path)
        assert held(team, "helper") == before
    team.wait(5.0)  # the parent's next process holds the child again, and asks it
    assert begun(team) == done
    assert ordered(team, RobotClient.step) == f"helper takes {before}"
    team.wait_until(lambda: len(begun(team)) == len(done) + 1, 60.0)
    ordered(team, RobotClient.go_on)
    assert tour.result() == [STEPS, STEPS]
    assert begun(team) == list(range(STEPS))


# -- real processes ------------------------------------------------------------------------------------


@pytest.mark.e2e
async def test_a_thread_of_the_pages_own_leaves_the_command_in_doubt(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host, "reply came 3")
    with pytest.raises(CommandInDoubt, match="thread of its page's own"):
        await stage.play(host, "threading", [], steps=6)
    assert stage.twice() == []
    stage.expect_silence()


@pytest.mark.e2e
async def test_a_host_that_is_ended_in_order_ends_its_commands_and_keeps_its_robots_and_their_pages(
    stage: Stage,
) -> None:
    host = stage.host()
    await stage.furnish(host)
    call = stage.begin("tour", steps=1000, pause=0.01)
    await stage.until_effects(5)
    await host.kill(signal.SIGTERM)
    with pytest.raises(VrError):
        await call
    acted = len(stage.ended)
    await host.start()
    await asyncio.sleep(0.3)
    assert len(stage.ended) <= acted + 1
    stage.effects_file.write_text("")
    assert await stage.realm_client.call("tourist", "pairs", {"steps": 2}) == [0, 2]
    stage.expect_once(0, 1)
    before = await stage.realm_client.call("tourist", "tour", {"steps": 2})
    other = stage.folder / "other.py"
    other.write_text(PAGES.read_text().replace("steps: int, pause", "steps: int = 4, pause"))
    await stage.realm_client.reload("tourist", str(other), "Tourist")
    other.unlink()
    await host.kill()
    await host.start()
    stage.effects_file.write_text("")
    assert await stage.realm_client.call("tourist", "tour", {}) == [steps + 4 for steps in before]
    stage.expect_once(*range(4))


@pytest.mark.e2e
async def test_a_stop_while_the_host_is_away_ends_the_command(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    call = stage.begin("tour", steps=1000, pause=0.01)
    await stage.until_effects(5)
    await host.kill()
    with contextlib.suppress(NotConfirmed):  # it names those who are away, if it has asked them
        await stage.realm_client.stop(None)
    acted = len(stage.ended)
    await host.start()
    with pytest.raises(VrError):
        await call
    await stage.realm_client.resume(None)
    await asyncio.sleep(0.3)
    assert len(stage.ended) <= acted + 1
    assert stage.twice() == []
    stage.expect_silence()


@pytest.mark.e2e
async def test_the_command_of_a_person_who_has_gone_meanwhile_ends(stage: Stage) -> None:
    host = stage.host()
    await stage.furnish(host)
    words = ("-m", "robotree.tui", "call", "tourist.tour", "steps=2000", "pause=0.01", "--within", "60 s")
    caller = stage.program("caller", *words)
    starting = asyncio.ensure_future(caller.start())
    await stage.until_effects(5)
    await host.kill()
    await caller.kill()
    await asyncio.gather(starting, return_exceptions=True)
    acted = len(stage.ended)
    await host.start()
    await asyncio.sleep(1.5)
    assert len(stage.ended) <= acted + 1, "only the step that was under way may end: nobody waits for more"
    assert stage.twice() == []
    assert "Traceback" not in host.complaints
