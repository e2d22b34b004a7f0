"""How a robot looks to the others: its description, its state, its listing."""

from __future__ import annotations

import inspect
import math
from typing import Any

from robotree.vr.address import Address
from robotree.vr.agents.call_counter import CallCounter
from robotree.vr.agents.commands import CommandDesk
from robotree.vr.agents.hooks import Hooks
from robotree.vr.agents.lease import LeaseKeeper
from robotree.vr.description import BondSpec, Listing, RobotDescription
from robotree.vr.requests import State
from robotree.vr.robot import Robot
from robotree.vr.virtual_robot import VirtualRobot


class Portrait:
    """Draws one robot, each time anew."""

    def __init__(
        self,
        robot: Robot,
        address: Address,
        host: str,
        lease: LeaseKeeper,
        desk: CommandDesk,
        calls: CallCounter,
    ) -> None:
        """Take the sitter and what is known of it."""
        self._robot, self._address, self._host = robot, address, host
        self._lease, self._desk, self._calls = lease, desk, calls
        self._hooks = Hooks(robot)

    def description(self) -> RobotDescription:
        """Describe the robot as it is now."""
        tenure, jobs = self._lease.tenure, self._desk.jobs
        bond = None
        if tenure is not None:
            remaining = max(self._lease.remaining, 0.0)
            bond = BondSpec(parent=tenure.parent, slot=tenure.slot, epoch=tenure.epoch, remaining=remaining)
        return RobotDescription(
            commands=self._desk.specs(),
            slots=self._robot.child_slots.specs() if isinstance(self._robot, VirtualRobot) else (),
            bond=bond,
            epoch=self._lease.lessor.epoch,
            busy="" if jobs.running is None else jobs.running.context.command,
            waiting=jobs.waiting,
            online=self._robot.online,
            stopped=bool(self._desk.stopped),
            stop_reason=self._desk.stopped,
            stops=self._desk.stops,
            abandoned=jobs.abandoned,
            readings=self._readings(),
            units={str(name): str(unit) for name, unit in self._robot.reading_units.items()},
            calls=self._calls.counts,
            doc=self._doc(),
            **self._identity(),
        )

    def state(self) -> State:
        """Tell how the robot is now, with its readings."""
        tenure, jobs = self._lease.tenure, self._desk.jobs
        running = jobs.running
        return State(
            busy="" if running is None else running.context.command,
            caller="" if running is None else running.context.caller,
            note="" if running is None else running.said,
            waiting=jobs.waiting,
            epoch=self._lease.lessor.epoch,
            bond=None if tenure is None else tenure.parent,
            online=self._robot.online,
            stopped=bool(self._desk.stopped),
            stop_reason=self._desk.stopped,
            abandoned=jobs.abandoned,
            readings=self._readings(),
        )

    def _readings(self) -> dict[str, float]:
        readings, running = dict(self._hooks.readings()), self._desk.jobs.running
        if running is not None and not math.isnan(running.fraction):
            readings["progress"] = running.fraction
        return readings

    def listing(self) -> Listing | None:
        """Return what a lookup service should hold of it: nothing while it is enslaved."""
        if self._lease.tenure is not None:
            return None
        return Listing(
            commands=tuple(spec.name for spec in self._desk.specs() if spec.available),
            doc=self._doc().partition("\n")[0],
            **self._identity(),
        )

    def _doc(self) -> str:
        return inspect.cleandoc(type(self._robot).__doc__ or "")

    def _identity(self) -> dict[str, Any]:
        return {
            "address": self._address,
            "kinds": self._robot.kinds(),
            "host": self._host,
            "attributes": {str(name): str(value) for name, value in self._robot.attributes.items()},
        }
