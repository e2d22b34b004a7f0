"""A realm in memory with a cart, and the seat of an assistant, without the protocol."""

from __future__ import annotations

import contextlib
import os
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import Annotated, Any

from robotree.assistants.keys import AssistantKeys
from robotree.assistants.seat import Going, Seat
from robotree.assistants.serving import floor_of
from robotree.vr import Child, Range, Robot, Unit, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.permit import PermittedCall
from robotree.vr.base.policy import Person, PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import user_name
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.permit_file import PermitFiles
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork
from tests.waiting import until

STEP = 0.01
"""[m] of a cart in each of its steps, of as many seconds."""


class Cart(Robot):
    """A cart."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.at = 0.0

    def readings(self) -> dict[str, float]:
        return {"x": self.at, "y": 0.0}

    @command
    def walk(self, x: Annotated[float, Unit("m"), Range(-5, 2000)]) -> None:
        """Walk to a place."""
        while self.at < x:
            self.sleep(STEP)
            self.at += STEP

    @command
    def wait(self) -> None:
        """Wait for ever."""
        while True:
            self.sleep(STEP)

    @command(effect="read")
    def where(self) -> float:
        """Where it is."""
        return self.at


class Lift(VirtualRobot):
    """A cart that is lifted."""

    cart = Child("Cart")

    @command
    def raise_it(self, x: float) -> None:
        """Raise it."""
        self.cart.walk(x=x)


class Gate(PolicyGate):
    """A policy, and the permits of its realm."""

    def __init__(self, folder: Path) -> None:
        self.permits = PermitFiles(folder)

    def expect_permit(self, asker: Person, call: PermittedCall) -> None:
        self.permits.expect(asker.assistant, call)


class Hall:
    """A realm with a cart, and the seat of an assistant."""

    def __init__(self, folder: Path) -> None:
        self.network, self.folder, self.cart = MemoryNetwork(), folder, Cart("cart-1")
        self.gate = self.network.gate = Gate(folder)
        self.realm_client = RealmClient(self.network.join("operator"))
        self.keys = AssistantKeys(folder)
        self.seat: Any = None

    def rule(self, terms: str = "", right: str = "command") -> None:
        self.gate.policy = read_policy(
            f"realm: test\nversion: 1\npersons: {{'{user_name(os.geteuid())}': all}}\n"
            f"assistants: {{claude: {{role: helper{terms}}}}}\n"
            f"roles: {{all: {{see: '*', command: '*', resume: '*'}}, helper: {{see: '*', {right}: '*'}}}}\n"
        )

    async def walk(self, x: float) -> Going:
        found: Going = await self.seat.call("cart-1", "walk", {"x": x}, "I was asked to", 60.0)
        return found

    async def far(self, terms: str = "") -> Going:
        """Begin to walk very far."""
        self.rule(terms)
        going = await self.walk(1000.0)
        await until(lambda: self.cart.at > 0, "it walks")
        return going

    @property
    def stopped(self) -> bool:
        return self.agent.description().stopped

    async def bring(self, stack: contextlib.AsyncExitStack, robot: Robot) -> RobotAgent:
        """Have a robot listed."""
        transport = self.network.join(robot.name)
        registrar = Registrar(transport)
        agent = RobotAgent(robot, transport, registrar=registrar)
        await agent.start()
        stack.push_async_callback(registrar.close)
        stack.push_async_callback(agent.close)
        return agent

    async def open(self, stack: contextlib.AsyncExitStack) -> None:
        lookup = LookupService(self.network.join("lookup"), "lookup")
        for part in (lookup, self.realm_client):
            await part.start()
            stack.push_async_callback(part.close)
        self.agent = await self.bring(stack, self.cart)
        await until(lambda: bool(self.realm_client.robots()), "it is listed")
        self.rule()
        self.floor = await stack.enter_async_context(floor_of(self.realm_client, self.folder))
        self.seat = Seat(self.floor, *self.keys.proved(self.keys.invite("claude")))
        await self.seat.start()
        stack.push_async_callback(self.seat.close)


@contextlib.asynccontextmanager
async def opened(folder: Path) -> AsyncGenerator[Hall]:
    async with contextlib.AsyncExitStack() as stack:
        found = Hall(folder)
        await found.open(stack)
        yield found
        found.rule()  # whoever still walks ends with the seat
