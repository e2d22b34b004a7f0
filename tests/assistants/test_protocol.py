"""The protocol over robots in memory, by its own client: attacks, floods, news of lists, and tasks."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any, Literal

import pytest
from mcp import Client
from mcp.client import ClaimContext, ClientExtension, ResultClaim
from mcp_types import CallToolResult, Request, RequestParams, Result, TextContent

from robotree.assistants.seat import Seat
from robotree.assistants.server import TASKS, AssistantServer
from robotree.vr.base.policy_reading import read_policy
from tests.assistants.conftest import ME, RULES, text
from tests.assistants.hall import Cart, Hall
from tests.waiting import PATIENCE, until


@pytest.fixture
async def carts(hall: Hall) -> AsyncIterator[dict[str, Cart]]:
    """Three carts under the policy of `conftest`."""
    async with contextlib.AsyncExitStack() as stack:
        found = {"cart-1": hall.cart} | {name: Cart(name) for name in ("cart-2", "secret")}
        for name in ("cart-2", "secret"):
            await hall.bring(stack, found[name])
        await until(lambda: len(hall.floor.catalogue.robots) == 3, "all are listed")
        hall.gate.policy = read_policy(RULES.format(version=1, me=ME, calls=1000))
        yield found


def client_of(seat: Seat, *extensions: ClientExtension, **given: Any) -> Client:
    server = AssistantServer(seat).server
    return Client(server, extensions=extensions or None, read_timeout_seconds=PATIENCE, **given)


async def test_a_hostile_assistant_reaches_no_robot(hall: Hall, carts: dict[str, Cart]) -> None:
    async with client_of(hall.seat) as client:
        assert "secret" not in text(await client.call_tool("robotree_robots", {}))
        forged: list[tuple[str, dict[str, Any]]] = [
            ("secret__walk", {"x": 1, "_why": "w"}),
            ("cart-1__resume", {"_why": "w"}),
            ("robotree_resume", {}),
            ("cart-1__walk", {"x": 1}),
            ("cart-1__walk", {"x": 2000.1, "_why": "w"}),
            ("cart-1__walk", {"x": "9 km", "_why": "w"}),
            ("cart-1__walk", {"x": 1e999, "_why": "w"}),
            ("cart-1__walk", {"x": 1, "_why": "w", "_within": -1}),
            ("cart-1__walk", {"x": 1, "_why": "w", "epoch": 99}),
            ("cart-1__walk", {"x": [1], "_why": ["w"]}),
            ("robotree_permit", {"permit": "../policy"}),
            ("robotree_permit", {"permit": "abcdefgh"}),
            ("robotree_withdraw", {"permit": "cart-1"}),
        ]
        for name, given in forged:
            answer = await client.call_tool(name, given)
            assert answer.is_error, (name, given, text(answer))
        for uri in ("robotree://robot/secret", "file:///etc/passwd", "robotree://view/none"):
            with pytest.raises(Exception, match=r"may not see|no resource|no view|NoSuchView|There|there"):
                await client.read_resource(uri)
        # a permit of before a stop is worth nothing after it, though a person has said yes and resumed
        asked = await client.call_tool("cart-2__walk", {"x": 2, "_why": "w"})
        permit = str((asked.structured_content or {})["permit"])
        hall.floor.permits.answer(permit, yes=True, by="anna")
        assert "cart-2" in text(await client.call_tool("robotree_stop", {"robot": "cart-2"}))
        assert (await client.call_tool("robotree_permit", {"permit": permit})).is_error
        await hall.realm_client.resume("cart-2")
        late = await client.call_tool("robotree_permit", {"permit": permit})
        assert "was stopped since" in text(late)
    assert len([each for each in hall.seat.record.entries() if each.became == "refused"]) >= 5
    # another assistant sees nothing of it
    other = Seat(hall.floor, *hall.keys.proved(hall.keys.invite("other")))
    await other.start()
    async with client_of(other) as client:
        assert {t.name for t in (await client.list_tools()).tools if "__" in t.name} == set()
        assert "there is no permit" in text(await client.call_tool("robotree_permit", {"permit": permit}))
        assert (await client.call_tool("cart-1__walk", {"x": 1, "_why": "w"})).is_error
    await other.close()
    assert [cart.at for cart in carts.values()] == [0, 0, 0]


@pytest.mark.usefixtures("carts")
async def test_more_calls_than_the_policy_allows_are_refused_and_a_stop_is_heard(hall: Hall) -> None:
    hall.gate.policy = read_policy(RULES.format(version=2, me=ME, calls=3))
    async with client_of(hall.seat) as client:
        told = [await client.call_tool("cart-1__where", {"_why": "w"}) for _ in range(4)]
        assert [one.is_error is True for one in told] == [False, False, False, True]
        assert "BudgetSpent" in text(told[-1])
        assert "cart-1" in text(await client.call_tool("robotree_stop", {"robot": "cart-1"}))


@pytest.mark.usefixtures("carts")
async def test_robots_come_and_go_in_the_lists_and_a_call_that_is_given_up_moves_nothing(hall: Hall) -> None:
    news: list[str] = []

    async def hear(message: Any) -> None:
        news.append(type(message).__name__)

    async with client_of(hall.seat, mode="legacy", message_handler=hear) as client:
        await client.list_tools()
        async with contextlib.AsyncExitStack() as stack:
            await hall.bring(stack, Cart("cart-3"))
            await until(lambda: "ToolListChangedNotification" in news, "it is told")
        walk = client.call_tool("cart-1__walk", {"x": 1000, "_why": "far"})
        going = asyncio.ensure_future(walk)
        await until(lambda: hall.cart.at > 0, "it walks")
        going.cancel()
        await asyncio.gather(going, return_exceptions=True)
        (call,) = hall.seat.going.values()
        await until(lambda: call.over, "it has ended")
        assert "the assistant gave up" in str(call.error)


# -- tasks -----------------------------------------------------------------------------------------


class Task(Result):
    """What a server answers instead of a result."""

    result_type: Literal["task"] = "task"
    task_id: str
    status: str
    status_message: str | None = None
    result: dict[str, Any] | None = None


class Polled(Task):
    """The same, as it is polled."""

    result_type: Literal["complete"] = "complete"  # type: ignore[assignment]
    task_id: str = ""
    status: str = ""


class TaskParams(RequestParams):
    task_id: str


class TaskRequest(Request[TaskParams, str]):
    method: str
    params: TaskParams
    name_param = "taskId"


class Tasks(ClientExtension):
    """The tasks extension, as far as a test needs it: it hands the task out."""

    identifier = TASKS

    def claims(self) -> list[ResultClaim[Task]]:
        async def resolve(task: Task, context: ClaimContext) -> CallToolResult:
            del context
            return CallToolResult(content=[TextContent(text=task.task_id)])

        return [ResultClaim(result_type="task", model=Task, resolve=resolve)]


async def test_a_command_that_goes_on_is_a_task_and_so_is_one_that_waits_for_a_person(
    hall: Hall, carts: dict[str, Cart]
) -> None:
    async with client_of(hall.seat, Tasks()) as client:

        async def look(task: str, method: str = "tasks/get") -> Task:
            request = TaskRequest(method=method, params=TaskParams(task_id=task))
            return await client.session.send_request(request, Polled)

        async def ended(task: str) -> Task:
            found: list[Task] = []

            async def over() -> bool:
                found.append(await look(task))
                return found[-1].status != "working"

            await until(over, "it has ended")
            return found[-1]

        async def is_under_way() -> bool:
            return "goes on" in ((await look(task)).status_message or "") and hall.cart.at > 0

        task = text(await client.call_tool("cart-1__walk", {"x": 1000, "_why": "a long way"}))
        await until(is_under_way, "its progress is seen")
        await look(task, "tasks/cancel")
        assert (await ended(task)).status == "cancelled"
        await until(lambda: hall.agent.description().busy == "", "it has ended")
        task = text(await client.call_tool("cart-1__walk", {"x": 1000, "_why": "a long way"}))
        assert "ends" in text(await client.call_tool("robotree_withdraw", {"permit": task}))
        assert (await ended(task)).result is not None
        # a permit is a task that waits; it can be taken back, or begins when it is asked for after the yes
        permit = text(await client.call_tool("cart-2__walk", {"x": 0.01, "_why": "w"}))
        await look(permit, "tasks/cancel")
        assert (await look(permit)).status == "cancelled"
        permit = text(await client.call_tool("cart-2__walk", {"x": 0.02, "_why": "w"}))
        assert (await look(permit)).status == "working"
        hall.floor.permits.answer(permit, yes=True, by="anna")
        done = await ended(permit)
        assert (done.status, done.result is None) == ("completed", False)
        assert done.result is not None
        assert done.result["structuredContent"]["observed"]["x"] == pytest.approx(carts["cart-2"].at)
        assert carts["cart-2"].at >= 0.02
