"""Assistants over streamable HTTP on loopback: tokens, tasks with progress and cancel, and silence."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Generator
from typing import Any, Literal

import httpx2
import pytest
from mcp import Client
from mcp.client import ClaimContext, ClientExtension, ResultClaim
from mcp.client.streamable_http import streamable_http_client
from mcp_types import CallToolResult, Request, RequestParams, Result, TextContent

from tests.assistants.conftest import Plant
from tests.waiting import until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(400)]
PATIENT = 60.0
TASKS = "io.modelcontextprotocol/tasks"


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


@contextlib.asynccontextmanager
async def client_of(address: str, key: str, *extensions: ClientExtension) -> AsyncGenerator[Client]:
    async with httpx2.AsyncClient(headers={"Authorization": f"Bearer {key}"}, timeout=PATIENT) as http:
        door = streamable_http_client(address, http_client=http)
        async with Client(door, extensions=extensions or None, read_timeout_seconds=PATIENT) as client:
            yield client


@pytest.fixture
def address(plant: Plant) -> Generator[str]:
    yield plant.machine.start("mcp", "mcp", "--http", "0")
    plant.machine.end("mcp")


async def look(client: Client, task: str, method: str = "tasks/get") -> Task:
    request = TaskRequest(method=method, params=TaskParams(task_id=task))
    return await client.session.send_request(request, Polled)


async def test_only_who_has_a_key_comes_in_and_long_commands_are_tasks(plant: Plant, address: str) -> None:
    async with httpx2.AsyncClient(timeout=PATIENT) as stranger:
        for headers in ({}, {"Authorization": "Bearer rtk_forged"}, {"Authorization": "Basic x"}):
            assert (await stranger.post(address, headers=headers, json={})).status_code == 401
        web = {"Authorization": f"Bearer {plant.keys['claude']}", "Origin": "https://evil.example"}
        assert (await stranger.post(address, headers=web, json={})).status_code == 403
    async with client_of(address, plant.keys["other"]) as other:
        assert [t.name for t in (await other.list_tools()).tools if "__" in t.name] == []
    async with client_of(address, plant.keys["claude"], Tasks()) as client:
        # a command that goes on is a task; its progress is seen, and it can be cancelled
        walk = {"x": 3, "seconds": 60, "_why": "a long way"}
        task = (await client.call_tool("cart-1__walk", walk)).content[0].text  # type: ignore[union-attr]
        await until_progress(client, task)
        await look(client, task, "tasks/cancel")
        await ended(client, task, "cancelled")
        assert plant.say("show", "cart-1").get("busy", "") == ""  # type: ignore[attr-defined]
        # a permit is a task that waits; it begins when it is asked for after the yes
        asked = await client.call_tool("cart-2__walk", {"x": 1, "_why": "w"})
        permit = asked.content[0].text  # type: ignore[union-attr]
        assert (await look(client, permit)).status == "working"
        plant.say("permit", "allow", permit)
        done = await ended(client, permit, "completed")
        assert done.result is not None
        assert done.result["structuredContent"]["observed"]["x"] == 1.0
        # who is silent is gone: its commands end
        task = (await client.call_tool("cart-1__walk", walk)).content[0].text  # type: ignore[union-attr]
    await until(lambda: plant.say("show", "cart-1").get("busy", "") == "", PATIENT)  # type: ignore[attr-defined]
    gone = [each for each in plant.say("assistants", "claude") if each["what"] == "gone"]  # type: ignore[attr-defined]
    assert gone
    plant.say("assistant", "revoke", "other")
    async with httpx2.AsyncClient(timeout=PATIENT) as stranger:
        headers = {"Authorization": f"Bearer {plant.keys['other']}"}
        assert (await stranger.post(address, headers=headers, json={})).status_code == 401


async def until_progress(client: Client, task: str) -> None:
    async with asyncio.timeout(PATIENT):
        while True:
            if "%" in ((await look(client, task)).status_message or ""):
                return
            await asyncio.sleep(0.2)


async def ended(client: Client, task: str, status: str) -> Task:
    async with asyncio.timeout(PATIENT):
        while True:
            if (found := await look(client, task)).status != "working":
                assert found.status == status, found
                return found
            await asyncio.sleep(0.2)
