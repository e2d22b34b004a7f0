"""Threads of an author's own that work for a command."""

from __future__ import annotations

import asyncio
import contextvars
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from robotree.vr import Child, CommandCancelled, Robot, VirtualRobot, VrError, command


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
