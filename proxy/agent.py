"""A proxy or a view as a whole: robot, agent, registration and connection, started and ended together."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Coroutine, Mapping
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

from robotree.protocol.errors import BadUrl
from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.links.url import parse
from robotree.protocol.messages import Mode
from robotree.protocol.services.fence import LAST_EPOCH
from robotree.proxy import kinds
from robotree.proxy.errors import BadController
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.session import CONTROLLER
from robotree.proxy.view import CAMERAS, WorkspaceView
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.run import Ready
from robotree.vr.agents.view import ViewAgent
from robotree.vr.base.transport import Transport
from robotree.vr.history.writer import HistoryWriter
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.local import join
from robotree.vr.orders.ledger import ORDERS, Ledger, OrderMemory, identity_in
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of


def _ignore(_: str) -> None:
    """Do nothing with the address."""


async def run_proxy(  # noqa: PLR0913 # what a person can say of it
    kind: str,
    name: str,
    url: str,
    *,
    realm: str | None = None,
    security: LinkSecurity = UNSIGNED,
    take_over: bool = False,
    component: int = CONTROLLER.component,
    keep: Path | None = None,
    ready: Ready = _ignore,
) -> None:
    """Run the proxy of one robot in a realm until cancelled. The controller may come and go.

    Args:
        kind: of robot, one of `kinds.KINDS`.
        name: of the robot, unique in the realm.
        url: where its controller listens, as `tcp:127.0.0.1:5760`.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        security: the keys of the link to the controller.
        take_over: have the controller obey this proxy also if another one holds it.
        component: MAVLink component of the controller that moves the robot.
        keep: folder in which the history of the robot is kept; None: nowhere.
        ready: called with the address once the robot can be called.

    Raises:
        UnknownKind: there is no such kind of robot.
        BadName: that cannot be a name.
        BadController: the address means nothing.
        DuplicateName: a living robot has the name.
        TransportError: the realm cannot be joined.
    """
    robot = kinds.make(kind, name, _checked(url), security=security, take_over=take_over, component=component)
    if keep is None:
        await _serve(lambda transport: running_proxy(robot, transport), realm, ready)
        return
    runner = runner_of(asyncio.get_running_loop())
    history = HistoryWriter(keep, runner.now, runner.unix)
    process: Process = Process(runner, None, history.machine_of)
    identity = identity_in(keep, robot.kinds()[0])
    orders = OrderMemory(Ledger(keep / ORDERS), identity)
    history.start()
    try:
        await _serve(
            lambda transport: running_proxy(
                robot, transport, process=process, orders=orders, history=history
            ),
            realm,
            ready,
        )
    finally:
        process.close()
        history.close()
        orders.ledger.close()


async def run_view(
    name: str,
    url: str,
    *,
    realm: str | None = None,
    security: LinkSecurity = UNSIGNED,
    cameras: Mapping[str, int] = CAMERAS,
    ready: Ready = _ignore,
) -> None:
    """Run the view of one workspace in a realm until cancelled, as `run_proxy` does the proxy of a robot.

    `url` is where the controller listens whose `cameras` it uses: components by the name of the camera.
    """
    view = WorkspaceView(name, _checked(url), security=security, cameras=cameras)
    await _serve(lambda transport: running_view(view, transport), realm, ready)


async def _serve(
    running: Callable[[Transport], AbstractAsyncContextManager[RobotAgent | ViewAgent]],
    realm: str | None,
    ready: Ready,
) -> None:
    """Join the realm and run an agent there: a robot's until it is closed from outside, a view's for ever."""
    transport = await join(realm)
    try:
        async with running(transport) as agent:
            ready(agent.address.key)
            await (agent.closed if isinstance(agent, RobotAgent) else asyncio.Event()).wait()
    finally:
        await transport.close()


@asynccontextmanager
async def running_proxy(
    robot: RobotProxy,
    transport: Transport,
    *,
    process: Process | None = None,
    orders: OrderMemory | None = None,
    history: HistoryWriter | None = None,
) -> AsyncGenerator[RobotAgent]:
    """Run a robot's proxy inside the block.

    Args:
        robot: the proxy.
        transport: the way to the other agents.
        process: whose threads carry its commands out; None: one of its own.
        orders: its memory of its orders; None: it takes none.
        history: what it keeps of what the robot did; None: nothing is kept.

    Yields:
        Its agent.

    Raises:
        DuplicateName: a living robot has the name.
        TransportError: the transport does not work.
    """
    registrar = Registrar(transport)
    agent = RobotAgent(
        robot,
        transport,
        registrar=registrar,
        obeyed=lambda: _obeyed_epoch(robot),
        process=process,
        orders=orders,
        history=history,
    )
    robot.on_change = agent.notify
    async with _running(agent, registrar, robot.run):
        yield agent


@asynccontextmanager
async def running_view(view: WorkspaceView, transport: Transport) -> AsyncGenerator[ViewAgent]:
    """Run a view inside the block, as `running_proxy` does a robot's proxy; yields its agent."""
    registrar = Registrar(transport)
    agent = ViewAgent(view, transport, view.name, registrar=registrar)
    async with _running(agent, registrar, view.run):
        yield agent


@asynccontextmanager
async def _running(
    agent: RobotAgent | ViewAgent, registrar: Registrar, run: Callable[[], Coroutine[Any, Any, None]]
) -> AsyncGenerator[None]:
    """Run an agent and its connection inside the block; an error of the connection ends the block."""
    try:
        await agent.start()
        async with asyncio.TaskGroup() as group:
            connection = group.create_task(run())
            try:
                yield
            finally:
                await agent.close()
                connection.cancel()
    except BaseExceptionGroup as failed:
        raise failed.exceptions[0] from None
    finally:
        await registrar.close()


def _obeyed_epoch(robot: RobotProxy) -> int | None:
    """Return the epoch that its controller obeys; the robot's leases must have larger ones.

    None: none was reported yet, or the proxy's claim takes care of it; 0: there is no larger one.
    """
    session = robot._session  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    if session.claims or session.twin.latest(Mode) is None:
        return None
    epoch = robot.controller_epoch
    return epoch if epoch < LAST_EPOCH else 0


def _checked(url: str) -> str:
    """Check an address before anything is joined or opened.

    Raises:
        BadController: it means nothing.
    """
    try:
        parse(url)
    except BadUrl as error:
        raise BadController(detail=str(error)) from error
    return url
