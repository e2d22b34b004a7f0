"""Cores of robots without an agent, as they begin."""

from __future__ import annotations

from robotree.vr.base.address import Address
from robotree.vr.base.description import SlotSpec
from robotree.vr.core.bonds import GrantedLease, Slots
from robotree.vr.core.machine import Calls, RobotCore, RobotState
from robotree.vr.core.stop import Stop


def new_core(name: str, *slots: SlotSpec, unix: float = 0.0) -> RobotCore:
    """Return the core of a free robot with empty slots; `unix`: when it was made [s]."""
    return RobotCore(
        RobotState(
            address=Address("robot", name, "1"),
            home="host h",
            lease=GrantedLease.free(name, unix=unix),
            slots=Slots.empty(name, slots),
            calls=Calls(),
            stop=Stop(),
        )
    )
