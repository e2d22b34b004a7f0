"""The Model Context Protocol over one seat: tools, resources, tasks, and news of the lists.

Tasks are the protocol's extension of that name (`io.modelcontextprotocol/tasks`, SEP-2663): a client that
declares it gets a task for a command that goes on, and for one that waits for a person; all others wait in
their request, with progress, and ask for a permit by the tool `robotree_permit`.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import math
import time
from collections.abc import Generator
from datetime import UTC, datetime
from typing import Any, Final
from urllib.parse import quote, unquote

import mcp_types as types
from mcp.server.context import ServerRequestContext
from mcp.server.lowlevel.server import NotificationOptions, Server
from mcp.server.models import InitializationOptions
from mcp.server.session import ServerSession
from mcp.server.subscriptions import (
    InMemorySubscriptionBus,
    ListenHandler,
    ResourcesListChanged,
    ToolsListChanged,
)
from mcp.shared.exceptions import MCPError
from mcp_types.version import HANDSHAKE_PROTOCOL_VERSIONS

from robotree.assistants.marking import DATA, data_of, said
from robotree.assistants.seat import Going, Seat, explained, usual_within
from robotree.assistants.tools import WHY, WITHIN, CommandTool
from robotree.vr.base.errors import BadArgument, PermitNeeded, VrError
from robotree.vr.base.foreign import bounded
from robotree.vr.base.permit import Permit

HUNG_UP: Final = "robotree.hung_up"
"""Under this name the scope of an HTTP request has an event, set when its connection has ended."""
TASKS: Final = "io.modelcontextprotocol/tasks"
POLL: Final = 500
"""[ms] between two looks at a task, as we ask clients for."""
KEPT: Final = 600_000
"""[ms] for which the end of a task can be asked for."""
AT_ONCE: Final = 0.3
"""[s] in which a command may end and be answered at once, where it would become a task."""
PAGE: Final = 500
"""Tools or resources in one answer."""
LARGEST: Final = 64 * 1024
"""[B] of the arguments of one call."""
PINGS: Final = 5.0
"""[s] between two pings to a client of an earlier version, while its request waits."""
PONG: Final = 10.0
"""[s] in which it must answer one."""
STREAMS: Final = 4
"""Listening streams of one assistant."""
INSTRUCTIONS: Final = (
    "These are real robots of a robotree realm; moving them can hurt people. Each tool ROBOT__COMMAND has one"
    " command carried out; numbers are in the units that its schema names. Say why in `_why`: people read it."
    " Some calls need a person's yes: the answer names a permit; ask for it with robotree_permit, and do not"
    " repeat the call."
    " robotree_stop stops robots at once and is always allowed; only people resume. " + DATA
)
_Context = ServerRequestContext[Any, Any]


def _own_tool(
    name: str, description: str, *needs: str, takes: tuple[str, ...] = (), **hints: bool
) -> dict[str, Any]:
    """Return a tool that belongs to no robot; its arguments, those that it needs and others, are texts."""
    text = {"type": "string", "maxLength": 80}
    schema = {
        "type": "object",
        "properties": dict.fromkeys((*needs, *takes), text),
        "required": [*needs],
        "additionalProperties": False,
    }
    tool = {"name": name, "description": description, "inputSchema": schema}
    return tool | ({"annotations": hints} if hints else {})


_OWN_TOOLS: Final = (
    _own_tool(
        "robotree_stop",
        "Protective stop of a robot and of those below it, or of all robots: at once, always allowed. Only a"
        " person can resume.",
        takes=("robot",),
        idempotentHint=True,
    ),
    _own_tool(
        "robotree_robots",
        "List the robots that you may see, with their state and readings.",
        readOnlyHint=True,
    ),
    _own_tool(
        "robotree_permit",
        "Look whether a person has said yes to your call; if so it begins now, once, and this waits for its"
        " end.",
        "permit",
    ),
    _own_tool(
        "robotree_withdraw",
        "Take back a permit that you do not need any more, or end a command of yours.",
        "permit",
    ),
    _own_tool(
        "robotree_look",
        "Take a picture of a workspace.",
        "view",
        takes=("camera",),
        readOnlyHint=True,
    ),
)


class TaskParams(types.RequestParams):
    """The parameters of `tasks/get`, `tasks/cancel` and `tasks/update`."""

    task_id: str


class AssistantServer:
    """Serves one seat."""

    def __init__(self, seat: Seat) -> None:
        """Take the seat; its assistant may have several connections."""
        self.seat = seat
        self._bus = InMemorySubscriptionBus()
        self._sessions: dict[int, ServerSession] = {}
        """Of clients of earlier versions of the protocol, which are told of changes by themselves."""
        self._listed: tuple[object, list[dict[str, Any]]] = (None, [])
        """All tools as they are listed, and the tools of the seat that they are made of."""
        listen = ListenHandler(self._bus, max_subscriptions=STREAMS)

        async def listening(
            ctx: _Context, params: types.SubscriptionsListenRequestParams
        ) -> types.SubscriptionsListenResult:
            with self._request():
                return await listen(ctx, params)

        self.server: Server[Any] = Server(
            "robotree",
            title="robotree",
            instructions=INSTRUCTIONS,
            on_list_tools=self._list_tools,
            on_call_tool=self._call_tool,
            on_list_resources=self._list_resources,
            on_list_resource_templates=self._list_templates,
            on_read_resource=self._read_resource,
            on_subscriptions_listen=listening,
        )
        self.server.extensions[TASKS] = {}
        self.server.add_request_handler("tasks/get", TaskParams, self._get_task)
        self.server.add_request_handler("tasks/cancel", TaskParams, self._cancel_task)
        self.server.add_request_handler("tasks/update", TaskParams, self._update_task)
        self.server.middleware.append(self._fill_list)
        self.hung_up = asyncio.Event()
        """Set while the client over stdio counts as gone; over HTTP each request says it of its own."""
        self._telling: set[asyncio.Task[None]] = set()
        seat.floor.catalogue.on_change(self._changed)

    def options(self) -> InitializationOptions:
        """Return what the server says of itself to clients of earlier versions."""
        return self.server.create_initialization_options(
            NotificationOptions(tools_changed=True, resources_changed=True)
        )

    @contextlib.contextmanager
    def _request(self, *, urgent: bool = False) -> Generator[None]:
        """Deal with a request: it shows that the assistant is there, and it is no flood."""
        try:
            self.seat.touch()
        except VrError as error:
            if not urgent:
                raise MCPError(types.INVALID_REQUEST, explained(error)) from None
        self.seat.open += 1
        try:
            yield
        except VrError as error:
            raise MCPError(types.INVALID_PARAMS, explained(error)) from None
        finally:
            self.seat.open -= 1

    # -- lists ------------------------------------------------------------------------------------

    async def _list_tools(self, ctx: _Context, params: types.PaginatedRequestParams | None) -> Any:
        with self._request():
            if (said_first := ctx.session.client_params) and _is_told(ctx):
                self._sessions[id(said_first)] = ctx.session  # the latest of each connection
            _, cursor = self._tools_page(None if params is None else params.cursor)
            return types.ListToolsResult(tools=[], next_cursor=cursor)  # `_fill_list` puts them in

    def _tools_page(self, cursor: str | None) -> tuple[list[dict[str, Any]], str | None]:
        """Return one page of tools as the protocol writes it: a tool is written once, not for each list."""
        tools = self.seat.tools()
        if self._listed[0] is not tools:
            self._listed = tools, [*_OWN_TOOLS, *map(_tool, tools.values())]
        return _page(self._listed[1], cursor)

    async def _fill_list(self, ctx: _Context, call_next: Any) -> Any:
        """Put the tools into a list that was answered without them.

        They were written by this server and are as its tests have them checked: the library would examine
        and copy each of thousands for each list (0.1 s for 3,000).
        """
        result: Any = await call_next(ctx)
        if ctx.method != "tools/list" or not isinstance(result, dict):
            return result
        page, _ = self._tools_page((ctx.params or {}).get("cursor"))
        result["tools"] = page
        return result  # pyright: ignore[reportUnknownVariableType] # the library's own

    async def _list_resources(
        self, ctx: _Context, params: types.PaginatedRequestParams | None
    ) -> types.ListResourcesResult:
        del ctx
        with self._request():
            found = [
                types.Resource(
                    uri=f"robotree://robot/{quote(name, safe='')}",
                    name=name,
                    mime_type="application/json",
                    description=f"State and readings of robot {bounded(name)} ({bounded(robot.kind)})",
                )
                for name, robot in self.seat.robots().items()
            ]
            found += [
                types.Resource(
                    uri=f"robotree://view/{quote(view.name, safe='')}",
                    name=view.name,
                    mime_type="image/jpeg",
                    description=f"Picture of {bounded(view.name)}",
                )
                for view in self.seat.views()
            ]
            shown, cursor = _page(found, None if params is None else params.cursor)
            return types.ListResourcesResult(resources=shown, next_cursor=cursor)

    async def _list_templates(
        self, ctx: _Context, params: types.PaginatedRequestParams | None
    ) -> types.ListResourceTemplatesResult:
        del ctx, params
        with self._request():
            return types.ListResourceTemplatesResult(
                resource_templates=[
                    types.ResourceTemplate(
                        uri_template="robotree://view/{view}/{camera}",
                        name="picture",
                        mime_type="image/jpeg",
                        description="A picture by one camera of a view",
                    )
                ]
            )

    async def _read_resource(
        self, ctx: _Context, params: types.ReadResourceRequestParams
    ) -> types.ReadResourceResult:
        del ctx
        with self._request():
            uri = str(params.uri)
            begin, _, rest = uri.partition("://")
            role, *names = [unquote(part) for part in rest.split("/")]
            if begin == "robotree" and role == "robot" and len(names) == 1:
                robot = await self.seat.describe(names[0])
                text = json.dumps(_shown(robot))
                return types.ReadResourceResult(
                    contents=[types.TextResourceContents(uri=uri, mime_type="application/json", text=text)]
                )
            if begin == "robotree" and role == "view" and len(names) in (1, 2):
                blob = base64.b64encode(
                    await self.seat.look(names[0], names[1] if len(names) > 1 else "")
                ).decode()
                return types.ReadResourceResult(
                    contents=[types.BlobResourceContents(uri=uri, mime_type="image/jpeg", blob=blob)]
                )
            raise MCPError(types.INVALID_PARAMS, f"there is no resource {bounded(uri)}")

    def _changed(self) -> None:
        task = asyncio.get_running_loop().create_task(self._tell_changes())
        self._telling.add(task)
        task.add_done_callback(self._telling.discard)

    async def _tell_changes(self) -> None:
        await self._bus.publish(ToolsListChanged())
        await self._bus.publish(ResourcesListChanged())
        for key, session in list(self._sessions.items()):
            try:
                await session.send_tool_list_changed()
                await session.send_resource_list_changed()
            except Exception:  # noqa: BLE001 # whatever a connection says that has ended
                self._sessions.pop(key, None)

    # -- calls ------------------------------------------------------------------------------------

    async def _call_tool(self, ctx: _Context, params: types.CallToolRequestParams) -> Any:
        with self._request(urgent=params.name == "robotree_stop"):
            given = params.arguments or {}
            try:
                if len(json.dumps(given)) > LARGEST:
                    raise BadArgument(command=bounded(params.name, 80), parameter="all of them",
                                      reason=f"they have more than {LARGEST} bytes")  # fmt: skip
                return await self._called(ctx, params.name, given)
            except PermitNeeded as needed:
                if _takes_tasks(ctx):
                    return self._task_of(self.seat.permit(str(needed.data["permit"])))
                return _answer(
                    {"permit": needed.data["permit"], "state": "waits"}, _WAITS.format(**needed.data)
                )
            except VrError as error:
                return _failure(explained(error))

    async def _called(self, ctx: _Context, name: str, given: dict[str, Any]) -> Any:
        match name:
            case "robotree_stop":
                robot = given.get("robot")
                stopped = await self.seat.stop(None if robot is None else str(robot))
                return _answer(
                    {"stopped": [*stopped]}, f"stopped: {', '.join(map(bounded, stopped)) or 'nobody'}"
                )
            case "robotree_robots":
                found = {
                    each: _shown(await self.seat.describe(each)) for each in [*self.seat.robots()][:PAGE]
                }
                return _answer({"robots": found})
            case "robotree_permit":
                return await self._permitted(ctx, str(given.get("permit", "")))
            case "robotree_withdraw":
                return _answer({"done": self.seat.withdraw(str(given.get("permit", "")))})
            case "robotree_look":
                picture = await self.seat.look(str(given.get("view", "")), str(given.get("camera", "")))
                image = types.ImageContent(data=base64.b64encode(picture).decode(), mime_type="image/jpeg")
                return types.CallToolResult(content=[image])
            case _:
                return await self._commanded(ctx, name, given)

    async def _commanded(self, ctx: _Context, name: str, given: dict[str, Any]) -> Any:
        tool = self.seat.tools().get(name)
        if tool is None:
            self.seat.spend_a_call()
            self.seat.record.write("refused", command=bounded(name, 80), text="there is no such tool for it")
            return _failure(f"there is no tool {bounded(name)} for you; the list may have changed")
        why = given.get(WHY)
        if not isinstance(why, str) or not why.strip():
            raise BadArgument(command=name, parameter=WHY, reason="say why you call it, as text")
        arguments = {key: value for key, value in given.items() if key not in (WHY, WITHIN)}
        going = await self.seat.call(
            tool.robot, tool.spec.name, arguments, why, usual_within(given.get(WITHIN))
        )
        return await self._followed(ctx, going)

    async def _permitted(self, ctx: _Context, permit: str) -> Any:
        found = self.seat.permit(permit)
        if found.state == "waits":
            return _answer({"permit": permit, "state": "waits"}, "nobody has answered yet; ask again later")
        if found.state in ("begun", "over", "denied", "withdrawn"):
            text = f"it is {found.state}" + (f": {said(found.outcome)}" if found.outcome else "")
            return _failure(f"permit {bounded(permit)} cannot be used: {text}")
        return await self._followed(ctx, await self.seat.begin(permit))

    async def _followed(self, ctx: _Context, going: Going) -> Any:
        """Wait for the end of a call, with progress; where the client takes tasks, not for long."""
        if _takes_tasks(ctx):
            return _ended(going) if await going.wait(AT_ONCE) else self._going_task(going)
        hanging_up: asyncio.Future[Any] = asyncio.ensure_future(self._hung_up(ctx).wait())
        pinging = asyncio.create_task(_ping(ctx))
        try:
            while not going.over:
                news = asyncio.ensure_future(going.news.wait())
                assert going.task is not None  # noqa: S101 # `Seat` has begun it
                waits: set[asyncio.Future[Any]] = {going.task, news}
                if not (hanging_up.done() or pinging.done()):
                    waits |= {hanging_up, pinging}
                await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
                news.cancel()
                going.news.clear()
                if hanging_up.done() or pinging.done():
                    going.end(_ENDED)
                elif not going.over and not math.isnan(going.fraction):
                    await ctx.session.report_progress(going.fraction, 1.0, going.text)
        except asyncio.CancelledError:
            going.end("the assistant gave up")
            raise
        finally:
            hanging_up.cancel()
            pinging.cancel()
        return _ended(going)

    def _hung_up(self, ctx: _Context) -> asyncio.Event:
        """Return what is set when the connection of a request has ended, or its client is stopped."""
        found = getattr(ctx.request, "scope", {}).get(HUNG_UP)
        return found if isinstance(found, asyncio.Event) else self.hung_up

    # -- tasks ------------------------------------------------------------------------------------

    async def _get_task(self, ctx: _Context, params: TaskParams) -> dict[str, Any]:
        del ctx
        with self._request():
            return await self._task(params.task_id)

    async def _task(self, task: str) -> dict[str, Any]:
        going = self.seat.going.get(task)
        if going is None:
            permit = self.seat.permit(task)
            if permit.state != "allowed":
                return self._task_of(permit) | {"resultType": "complete"}
            try:
                going = await self.seat.begin(task)
            except VrError as error:
                done = _failure(explained(error))
                return _envelope(
                    task, "completed", permit.asked, permit.answered, explained(error)
                ) | _result(done)
        if going.over:
            cancelled = going.why_ended == _CANCELLED
            state = "cancelled" if cancelled else "completed"
            known = _envelope(task, state, going.began, going.changed, going.text)
            return known if cancelled else known | _result(_ended(going))
        return self._going_task(going) | {"resultType": "complete"}

    async def _cancel_task(self, ctx: _Context, params: TaskParams) -> dict[str, Any]:
        del ctx
        with self._request(urgent=True):
            going = self.seat.going.get(params.task_id)
            if going is None:
                self.seat.withdraw(params.task_id)
            elif not going.over:
                going.end(_CANCELLED)
            return {}

    async def _update_task(self, ctx: _Context, params: TaskParams) -> dict[str, Any]:
        """Answer that nothing was asked: a person answers, never the client."""
        del ctx, params
        with self._request():
            return {}

    def _going_task(self, going: Going) -> dict[str, Any]:
        done = "" if math.isnan(going.fraction) else f"{going.fraction:.0%} "
        text = f"{going.robot}.{going.call.command} goes on: {done}{going.text}".rstrip(": ")
        return {"resultType": "task", **_envelope(going.id, "working", going.began, going.changed, text)}

    def _task_of(self, permit: Permit) -> dict[str, Any]:
        now = time.time()
        if permit.state == "waits" and not permit.expired(now):
            text = f"waits for a person's yes: permit {permit.id}"
            state = "working"
        else:
            state = "cancelled" if permit.state in ("withdrawn", "denied") else "completed"
            text = f"permit {permit.id} is {permit.state}" + (
                " and has expired" if permit.expired(now) else ""
            )
        known = _envelope(permit.id, state, permit.asked, permit.answered or permit.asked, text)
        if state == "completed":
            known |= _result(_failure(f"{text}. {said(permit.outcome)}"))
        return {"resultType": "task", **known}


_ENDED: Final = "the connection of the assistant has ended, or it gives no sign of life"
_CANCELLED: Final = "the assistant cancelled it"
_WAITS: Final = (
    "{robot}.{command} has not begun: it needs a person's yes. Permit {permit} waits. Ask with"
    ' robotree_permit {{"permit": "{permit}"}} later; do not repeat the call.'
)


def _is_told(ctx: _Context) -> bool:
    """Whether a client of an earlier version is told of changes without asking for it."""
    return ctx.protocol_version in HANDSHAKE_PROTOCOL_VERSIONS


async def _ping(ctx: _Context) -> None:
    """Ask a client of an earlier version for signs of life; returns when it does not answer one in time.

    Later versions have no such request: see `pipes.py`.
    """
    while _is_told(ctx):
        await asyncio.sleep(PINGS)
        try:
            async with asyncio.timeout(PONG):
                await ctx.session.send_ping()
        except TimeoutError:
            return
        except MCPError:
            continue  # it has answered
        except Exception:  # noqa: BLE001 # there is no way to ask it
            break
    await asyncio.get_running_loop().create_future()


def _takes_tasks(ctx: _Context) -> bool:
    known = ctx.session.client_capabilities
    return known is not None and TASKS in (known.extensions or {})


def _envelope(task: str, state: str, created: float, changed: float, text: str) -> dict[str, Any]:
    return {
        "taskId": task,
        "status": state,
        "statusMessage": bounded(text, 500),
        "createdAt": _iso(created),
        "lastUpdatedAt": _iso(changed),
        "ttlMs": KEPT,
        "pollIntervalMs": POLL,
    }


def _iso(unix: float) -> str:
    return datetime.fromtimestamp(unix, UTC).isoformat().replace("+00:00", "Z")


def _result(result: types.CallToolResult) -> dict[str, Any]:
    return {"result": result.model_dump(by_alias=True, mode="json", exclude_none=True)}


def _ended(going: Going) -> types.CallToolResult:
    try:
        value = going.result()
    except VrError as error:
        return _failure(explained(error))
    data: dict[str, Any] = {"key": going.call.key, "result": value}
    if going.observed:
        data["observed"] = data_of(going.observed)
    return _answer(data)


def _answer(data: dict[str, Any], text: str = "") -> types.CallToolResult:
    """Return an answer: plain data, which is also its text, since clients show one or the other."""
    shown = types.TextContent(text=text or json.dumps(data))
    return types.CallToolResult(content=[shown], structured_content=data)


def _failure(text: str) -> types.CallToolResult:
    return types.CallToolResult(content=[types.TextContent(text=text)], is_error=True)


def _shown(robot: Any) -> dict[str, Any]:
    """Return a robot as an assistant is shown it."""
    return {
        "name": bounded(robot.name),
        "kind": bounded(robot.kind),
        "says_of_itself": said(robot.doc),
        "busy": robot.busy,
        "online": robot.online,
        "stopped": robot.stopped,
        "stop_reason": said(robot.stop_reason) if robot.stop_reason else "",
        "readings": data_of(robot.readings),
        "units": data_of(robot.units),
    }


def _page(found: list[Any], cursor: str | None) -> tuple[list[Any], str | None]:
    """Return one page, and where the next one begins."""
    if cursor is not None and not (cursor.isascii() and cursor.isdigit() and len(cursor) < 9):
        raise MCPError(types.INVALID_PARAMS, "there is no such page")
    first = int(cursor or 0)
    after = first + PAGE
    return found[first:after], str(after) if after < len(found) else None


def _tool(each: CommandTool) -> dict[str, Any]:
    """Return a tool as the protocol writes it."""
    return {
        "name": each.name,
        "title": f"{bounded(each.robot)}.{bounded(each.spec.name)}",
        "description": each.description,
        "inputSchema": each.schema,
        "annotations": _HINTS[each.spec.effect],
    }


_HINTS: Final = {
    "read": {"readOnlyHint": True},
    "repeat": {"readOnlyHint": False, "destructiveHint": True, "idempotentHint": True},
    "once": {"readOnlyHint": False, "destructiveHint": True, "idempotentHint": False},
}
