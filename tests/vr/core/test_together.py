"""Several things at once: children in a block, and threads of an author's own."""

from __future__ import annotations

import asyncio
import contextvars
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from robotree.vr import (
    Child,
    ChildCancelled,
    CommandCancelled,
    CommandFailed,
    DeadlineExceeded,
    Failed,
    Robot,
    VirtualRobot,
    VrError,
    command,
)
from robotree.vr.base.errors import StillRunning


class Arm(Robot):
    """Takes its time, and may fail."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.done: list[str] = []
        self.keys: list[str] = []

    @command
    def go(self, seconds: float, *, well: bool = True) -> str:
        self.keys.append(self.context.key)
        try:
            self.sleep(seconds)
        except VrError:
            self.done.append("cancelled")
            raise
        self.done.append("went")
        if not well:
            raise Failed(f"{self.name} is stuck", after=seconds)
        return f"{self.name} after {seconds:g} s"


class Pair(VirtualRobot):
    """Two arms."""

    left = Child("Arm")
    right = Child("Arm")

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.saw: list[Any] = []
        self.release = threading.Event()

    @command
    def both(self, left: float, right: float, *, well: bool = True) -> Any:
        with self.together() as both:
            both.start(self.left.go, left, well=well)
            self.right.go.start(right)  # the same: what is started in the block belongs to it
        return both.results

    @command
    def calls_one_off(self, *, function: bool) -> Any:
        """One part is not needed after all."""
        with self.together() as both:
            needless = both.start(self.twice, self.left, 9) if function else both.start(self.left.go, 9)
            both.start(self.right.go, 2)
            self.sleep(1)
            needless.cancel()
            needless.cancel()
        return both.results

    @command
    def in_order(self) -> Any:
        """Two sequences of steps at the same time."""
        with self.together() as both:
            both.start(self.twice, self.left, 1)
            both.start(self.twice, self.right, 2)
        return both.results

    def twice(self, arm: Any, seconds: float) -> list[str]:
        return [arm.go(seconds), arm.go(seconds)]

    @command
    def fails_in_a_function(self) -> None:
        with self.together() as both:
            both.start(self.twice, self.left, 5)
            both.start(self.break_off)

    def break_off(self) -> None:
        self.sleep(1)
        raise Failed("broken")

    @command
    def raises_in_the_block(self) -> None:
        with self.together() as both:
            both.start(self.left.go, 9)
            self.sleep(1)
            raise Failed("second thoughts")

    @command
    def waits_in_the_block(self) -> None:
        with self.together() as both:
            both.start(self.left.go, 1, well=False)
            self.saw.append("waits")
            self.sleep(60)
            self.saw.append("waited too long")

    @command
    def nested(self, seconds: float) -> Any:
        with self.together() as outer:
            outer.start(self.left.go, seconds, well=False)
            with self.together() as inner:
                inner.start(self.right.go, 3)
            self.saw += inner.results
        return outer.results

    @command
    def race(self, left: float, right: float, *, well: bool = True) -> Any:
        with self.first() as race:
            race.start(self.left.go, left, well=well)
            race.start(self.right.go, right, well=well)
        return [race.winner, race.result]

    @command
    def won_before_all_have_started(self) -> Any:
        with self.first() as race:
            race.start(self.left.go, 0)
            self.sleep(1)
            late = race.start(self.right.go, 1)
            try:
                late.result()
            except ChildCancelled as error:
                self.saw.append(str(error))
        return race.result

    @command
    def nothing(self) -> Any:
        with self.together() as both:
            self.saw.append("empty")
        return both.results

    @command
    def no_race(self) -> None:
        with self.first():
            pass

    @command
    def after_the_block(self) -> None:
        with self.together() as both:
            pass
        both.start(self.left.go, 1)

    @command
    def too_early(self) -> Any:
        with self.together() as both:
            return both.results

    @command
    def deaf(self) -> None:
        with self.together() as both:
            both.start(self.ignore)
            self.sleep(1)
            raise Failed("enough")

    @command
    def hears_nothing(self) -> None:
        with self.together() as both:
            both.start(self.twice, self.left, 60)
            self.release.wait()

    def ignore(self) -> None:
        while True:
            try:
                self.sleep(1)
            except BaseException:  # noqa: BLE001, S112 # an author who has not thought of ending
                continue


@pytest.fixture
async def pair(homes: Any) -> Any:
    return await homes.team(Pair("pair"), left=Arm("left"), right=Arm("right"))


async def timed(call: Any) -> tuple[float, Any]:
    """Return how long a call takes [s], and what it returns or raises."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    try:
        outcome = await call
    except VrError as error:
        outcome = error
    return loop.time() - began, outcome


async def idle(realm: Any, *agents: Any) -> None:
    await realm.until(lambda: not any(agent.description().busy for agent in agents), within=1.0)


# -- all of them -----------------------------------------------------------------------------------


async def test_two_arms_move_at_the_same_time_and_the_block_waits_for_both(realm: Any, pair: Any) -> None:
    took, results = await timed(realm.client(pair).call("both", {"left": 3, "right": 1}, key="k"))
    assert results == ["left after 3 s", "right after 1 s"]
    assert took == pytest.approx(3, abs=0.2)
    assert (pair.left.robot.keys, pair.right.robot.keys) == (["k/1"], ["k/2"])


async def test_the_first_failure_cancels_the_others_and_is_what_is_raised(realm: Any, pair: Any) -> None:
    took, error = await timed(realm.client(pair).call("both", {"left": 1, "right": 9, "well": False}))
    assert (type(error), str(error)) == (Failed, "left.go failed: left is stuck (after=1.0)")
    assert took < 1.5
    await idle(realm, pair.right)
    assert pair.right.robot.done == ["cancelled"]


@pytest.mark.parametrize("function", [False, True])
async def test_a_part_that_the_page_itself_cancels_is_no_failure(
    realm: Any, pair: Any, *, function: bool
) -> None:
    _, results = await timed(realm.client(pair).call("calls_one_off", {"function": function}))
    assert results == [None, "right after 2 s"]
    assert (pair.left.robot.done, pair.right.robot.done) == (["cancelled"], ["went"])


async def test_sequences_of_steps_run_side_by_side_with_keys_that_repeat(realm: Any, pair: Any) -> None:
    took, results = await timed(realm.client(pair).call("in_order", {}, key="k"))
    assert results == [["left after 1 s"] * 2, ["right after 2 s"] * 2]
    assert took == pytest.approx(4, abs=0.3)
    assert pair.left.robot.keys == ["k/1/1", "k/1/2"]
    assert pair.right.robot.keys == ["k/2/1", "k/2/2"]


async def test_a_function_that_fails_cancels_the_steps_of_the_other(realm: Any, pair: Any) -> None:
    took, error = await timed(realm.client(pair).call("fails_in_a_function", {}))
    assert str(error) == "pair.fails_in_a_function failed: broken"
    assert any("in break_off: raise Failed" in line for line in error.trace)
    assert took < 1.5
    await idle(realm, pair.left)
    assert pair.left.robot.done == ["cancelled"]


async def test_an_error_in_the_block_cancels_what_it_has_started(realm: Any, pair: Any) -> None:
    _, error = await timed(realm.client(pair).call("raises_in_the_block", {}))
    assert str(error) == "pair.raises_in_the_block failed: second thoughts"
    await idle(realm, pair.left)
    assert pair.left.robot.done == ["cancelled"]


async def test_a_failure_ends_the_block_while_it_waits_for_something_else(realm: Any, pair: Any) -> None:
    took, error = await timed(realm.client(pair).call("waits_in_the_block", {}))
    assert str(error).startswith("left.go failed")
    assert took < 1.5
    assert pair.robot.saw == ["waits"]


async def test_blocks_can_be_nested(realm: Any, pair: Any) -> None:
    took, error = await timed(realm.client(pair).call("nested", {"seconds": 5}))
    assert (type(error), pair.robot.saw) == (Failed, ["right after 3 s"])
    took, error = await timed(realm.client(pair).call("nested", {"seconds": 1}))
    assert took < 1.5, "a failure of the outer block ends the inner one"
    await idle(realm, pair.right)
    assert pair.right.robot.done == ["went", "cancelled"]


async def test_an_empty_block_has_no_results(realm: Any, pair: Any) -> None:
    assert await realm.client(pair).call("nothing", {}) == []


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("after_the_block", "start parts inside of the `with` block"),
        ("too_early", "the results are there after"),
    ],
)
async def test_a_block_used_wrongly_says_how_it_is_used(
    realm: Any, pair: Any, command: str, sentence: str
) -> None:
    with pytest.raises(CommandFailed, match=sentence):
        await realm.client(pair).call(command, {})


# -- the first one ---------------------------------------------------------------------------------


async def test_the_first_that_succeeds_wins_and_the_others_are_cancelled(realm: Any, pair: Any) -> None:
    took, result = await timed(realm.client(pair).call("race", {"left": 9, "right": 1}))
    assert result == [1, "right after 1 s"]
    assert took < 1.5
    await idle(realm, pair.left)
    assert pair.left.robot.done == ["cancelled"]


async def test_when_all_have_failed_one_error_lists_them(realm: Any, pair: Any) -> None:
    took, error = await timed(realm.client(pair).call("race", {"left": 2, "right": 1, "well": False}))
    assert took == pytest.approx(2, abs=0.2)
    assert str(error) == (
        "pair.race failed: none of 2 has succeeded: left.go failed: left is stuck (after=2.0); "
        "right.go failed: right is stuck (after=1.0)"
    )


async def test_what_is_started_after_the_race_was_won_does_not_begin(realm: Any, pair: Any) -> None:
    assert await realm.client(pair).call("won_before_all_have_started", {}) == "left after 0 s"
    assert pair.right.robot.done == []
    assert pair.robot.saw[0].endswith("another one has succeeded")


async def test_a_race_of_nobody_says_so(realm: Any, pair: Any) -> None:
    with pytest.raises(Failed, match="nothing was started"):
        await realm.client(pair).call("no_race", {})


# -- ended from outside ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "how"),
    [
        *(("both", "cancel"), ("both", "deadline"), ("in_order", "stop"), ("in_order", "cancel")),
        *(("race", "stop"), ("nested", "deadline")),
    ],
)
async def test_the_end_of_a_command_ends_all_that_it_has_started(
    realm: Any, pair: Any, command: str, how: str
) -> None:
    arguments = {"both": {"left": 9, "right": 9}, "race": {"left": 9, "right": 9}, "nested": {"seconds": 9}}
    client = realm.client(pair)
    call = client.call(command, arguments.get(command, {}), deadline=0.5 if how == "deadline" else 60)
    running = asyncio.create_task(timed(call))
    await realm.until(lambda: pair.left.description().busy == pair.right.description().busy == "go")
    if how == "cancel":
        await client.cancel(reason="enough")
    elif how == "stop":
        await client.safe_stop("a hand")
    _, error = await running
    assert type(error) is (DeadlineExceeded if how == "deadline" else CommandCancelled)
    await idle(realm, pair, pair.left, pair.right)
    assert pair.left.robot.done[-1] == pair.right.robot.done[-1] == "cancelled"


@pytest.mark.real_threads
async def test_a_cancel_reaches_a_function_of_the_page_while_its_block_hears_nothing(
    realm: Any, pair: Any
) -> None:
    task = asyncio.create_task(timed(realm.client(pair).call("hears_nothing", {}, key="k")))
    await realm.until(lambda: pair.left.description().busy == "go")
    await realm.client(pair).cancel("k", reason="enough")
    await realm.until(lambda: pair.left.description().busy == "", within=20)
    assert pair.left.robot.done == ["cancelled"]
    pair.robot.release.set()
    assert isinstance((await task)[1], CommandCancelled)


async def test_a_part_that_ignores_its_end_is_given_up_with_the_command(realm: Any, pair: Any) -> None:
    _, error = await timed(realm.client(pair).call("deaf", {}))
    assert isinstance(error, StillRunning)
    assert pair.description().abandoned == ("deaf",)


# -- threads of an author's own that work for a command --------------------------------------------


class Camera(Robot):
    """Takes pictures."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.keys: list[str] = []

    @command(effect="read")
    def take(self, number: int) -> int:
        self.keys.append(f"{number}: {self.context.key}")
        return number * 10

    @command
    def expose(self) -> None:
        self.sleep(60)


class Studio(VirtualRobot):
    """Lets threads do some of the work."""

    camera = Child("Camera")

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.left: list[Any] = []
        self.saw: list[str] = []

    def take(self, number: int) -> int:
        return int(self.camera.take(number))

    @command
    def pooled(self) -> Any:
        with ThreadPoolExecutor(3) as pool:
            return list(pool.map(self.take, range(4)))

    @command
    def with_asyncio(self) -> Any:
        async def both() -> Any:
            return await asyncio.gather(*(asyncio.to_thread(self.take, number) for number in range(2)))

        return asyncio.run(both())

    @command
    def with_a_thread(self) -> Any:
        taken: list[int] = []
        thread = threading.Thread(
            target=contextvars.copy_context().run, args=(lambda: taken.append(self.take(7)),)
        )
        thread.start()
        thread.join()
        return taken

    @command
    def with_a_bare_thread(self) -> Any:
        said: list[str] = []

        def work() -> None:
            try:
                self.take(1)
            except RuntimeError as error:
                said.append(str(error))

        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
        return said

    @command
    def waits(self) -> None:
        with ThreadPoolExecutor(1) as pool:
            pool.submit(self.expose).result()

    def expose(self) -> None:
        try:
            self.camera.expose()
        except VrError as error:
            self.saw.append(str(error))
            raise

    @command
    def leaves_a_thread(self) -> None:
        go_on, pool = threading.Event(), ThreadPoolExecutor(1)
        self.left += [go_on, pool.submit(self.late, go_on)]

    @command
    def leaves_a_context(self) -> None:
        go_on, done = threading.Event(), Future[None]()

        def work() -> None:
            self.late(go_on)
            done.set_result(None)

        threading.Thread(target=contextvars.copy_context().run, args=(work,)).start()
        self.left += [go_on, done]

    def late(self, go_on: threading.Event) -> None:
        go_on.wait()
        try:
            self.take(1)
        except VrError as error:
            self.saw.append(str(error))


@pytest.fixture
async def studio(homes: Any) -> Any:
    return await homes.team(Studio("studio"), camera=Camera("camera"))


@pytest.mark.real_threads
async def test_a_thread_pool_works_for_the_command_with_keys_that_repeat(realm: Any, studio: Any) -> None:
    assert await realm.client(studio).call("pooled", {}, key="k") == [0, 10, 20, 30]
    assert sorted(studio.camera.robot.keys) == ["0: k/1/1", "1: k/2/1", "2: k/3/1", "3: k/4/1"]


@pytest.mark.real_threads
@pytest.mark.parametrize(("command", "taken"), [("with_asyncio", [0, 10]), ("with_a_thread", [70])])
async def test_a_copied_context_works_for_the_command(
    realm: Any, studio: Any, command: str, taken: list[int]
) -> None:
    assert await realm.client(studio).call(command, {}, key="k") == taken
    assert all(key.split(": ")[1].startswith("k/t") for key in studio.camera.robot.keys)


@pytest.mark.real_threads
async def test_a_thread_without_the_context_is_told_how_to_get_it(realm: Any, studio: Any) -> None:
    (said,) = await realm.client(studio).call("with_a_bare_thread", {})
    assert "contextvars.copy_context().run" in said


@pytest.mark.real_threads
async def test_a_cancel_reaches_the_threads_of_a_command(realm: Any, studio: Any) -> None:
    task = asyncio.create_task(realm.client(studio).call("waits", {}, key="k"))
    await realm.until(lambda: studio.camera.description().busy == "expose")
    await realm.client(studio).cancel("k", reason="enough")
    with pytest.raises(CommandCancelled, match="enough"):
        await asyncio.wait_for(task, 5.0)
    await realm.until(lambda: not studio.camera.description().busy, within=5.0)
    assert studio.robot.saw == ["studio.waits was cancelled: enough"]


@pytest.mark.real_threads
@pytest.mark.parametrize("command", ["leaves_a_thread", "leaves_a_context"])
async def test_a_thread_that_outlives_its_command_reaches_no_child(
    realm: Any, studio: Any, command: str
) -> None:
    await realm.client(studio).call(command, {}, key="k")
    go_on, late = studio.robot.left
    go_on.set()
    await asyncio.wrap_future(late)
    assert studio.robot.saw == [
        f"studio.{command} was cancelled: the command for which this thread works has ended"
    ]
    assert studio.camera.robot.keys == []


async def test_in_virtual_time_a_pool_works_at_once_and_in_order(realm: Any, studio: Any) -> None:
    assert await realm.client(studio).call("pooled", {}, key="k") == [0, 10, 20, 30]
    assert studio.camera.robot.keys == ["0: k/1/1", "1: k/2/1", "2: k/3/1", "3: k/4/1"]


async def test_a_failure_in_a_pool_is_a_failure_of_the_command(realm: Any, studio: Any) -> None:
    await realm.client(studio).free("camera")
    with pytest.raises(VrError, match=r"studio\.camera is empty"):
        await realm.client(studio).call("pooled", {})
