"""One robot of a host, as its place is looked after: what it spends on whom, and what is found and done."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Protocol

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.unfit import unfit_reasons
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.errors import VrError
from robotree.vr.core import events as on
from robotree.vr.core.machine import RobotState
from robotree.vr.core.placement import Contact, PlaceAdvice, PlacedRobot, Placing
from robotree.vr.core.traffic import NO_FLOW


class Placeable(Protocol):
    """A robot whose place is looked after: in the process of its host, or in one of its own."""

    @property
    def came(self) -> bool:
        """Whether it has come from another host."""
        ...

    @property
    def placed(self) -> PlacedRobot | None:
        """What matters for its place; None: people alone move it, or it is on its way."""
        ...

    def show(self, advice: PlaceAdvice, text: str) -> None:
        """Take what a look at its place has shown, and say it as `text`."""
        ...

    def begin_move(self, advice: PlaceAdvice) -> None:
        """Note that it moves now, and why, for itself and for its log."""
        ...

    def end_move(self, advice: PlaceAdvice, reason: str) -> None:
        """Note why it has not moved."""
        ...


class AgentPlace:
    """A robot in this process. Lives on the event loop."""

    def __init__(self, agent: RobotAgent, unix: Callable[[], float]) -> None:
        """Take the robot, and the clock [s since 1970]."""
        self._agent, self._unix = agent, unix
        self._before: Placing | None = None

    @property
    def came(self) -> bool:
        """See `Placeable`; so are the others."""
        return bool(self._agent.runtime.came)

    @property
    def placed(self) -> PlacedRobot | None:
        runtime, robot = self._agent.runtime, self._agent.robot
        if runtime.placement == "manual" or self._agent.gone or runtime.is_on_way:
            return None
        assert isinstance(robot, VirtualRobot)  # noqa: S101 # no other one has a placement
        flows = runtime.traffic.flows(runtime.process.runner.now())
        family, placing = runtime.look(lambda state: (_family(state), state.placing))
        partners = [
            Contact(key, name, calls)
            for key, name in family.items()
            if (calls := flows.get(key, NO_FLOW).calls)
        ]
        strangers = sum(flow.calls for key, flow in flows.items() if key not in family)
        return PlacedRobot(
            name=robot.name,
            mode=runtime.placement,
            partners=partners,
            strangers=strangers,
            pinned=robot.pinned,
            unfit="; ".join(unfit_reasons(runtime)),
            urgent=runtime.look(commands_running) > 0,
            stay=placing.stay(self._unix()),
        )

    def show(self, advice: PlaceAdvice, text: str) -> None:
        runtime, before = self._agent.runtime, self._agent.runtime.advice
        if runtime.placement == "manual":  # a person has just said so
            return
        runtime.advice = text
        if advice.target and advice.target != runtime.advised and runtime.placement == "advise":
            runtime.log.say("info", f"it would be better off on {advice.target}: {text}")
        runtime.advised = advice.target
        if before != text:
            runtime.changed()

    def begin_move(self, advice: PlaceAdvice) -> None:
        runtime = self._agent.runtime
        self._before = runtime.look(lambda state: state.placing)
        runtime.log.say("info", f"it moves to {advice.target}: {advice.why}")
        runtime.post(on.PlacingSet(placing=self._before.moving(advice.why, self._unix())))

    def end_move(self, advice: PlaceAdvice, reason: str) -> None:
        runtime = self._agent.runtime
        runtime.advice = f"{advice.why}; but {reason}"
        runtime.log.say("warning", f"it has not moved: {reason}")
        if self._before is not None:
            with contextlib.suppress(VrError):
                runtime.post(on.PlacingSet(placing=self._before))


def _family(state: RobotState) -> dict[str, str]:
    """Return children and parent of a robot: names by key."""
    lease = state.lease.current
    parent = {} if lease is None else {lease.parent.key: lease.parent.name}
    return {bond.child.key: bond.child.name for bond in state.slots.bonds().values()} | parent


def commands_running(state: RobotState) -> int:
    """Return how many commands of a robot run."""
    return sum(1 for call in state.calls.live.values() if call.running)
