"""The publications of a robot: its description, state, listing, and the output of its code.

A change may come from any thread and very often; it only sets a flag (`RobotRuntime.has_news`). The state is
looked at at once after a change, and ten times a second while a command runs. It is published when it is
another one, and else once in each round of its process, or twice.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import logging
import math
from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any

import msgspec

from robotree.vr.agents.hooks import Hooks
from robotree.vr.agents.shared import ROUND, Shared
from robotree.vr.agents.streams import Streams
from robotree.vr.author.fields import StateField
from robotree.vr.author.virtual_robot import Service, VirtualRobot, expect_lendable
from robotree.vr.base.description import BondSpec, Listing, RobotDescription, SlotSpec
from robotree.vr.base.errors import TransportError, VrError
from robotree.vr.base.permissions import Isolation
from robotree.vr.base.presence import Undo
from robotree.vr.base.requests import LogLines, State, encode
from robotree.vr.base.transport import Transport
from robotree.vr.core.machine import RobotState
from robotree.vr.core.traffic import NO_FLOW, Flow
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.runner import soon

QUICK = 0.1
"""[s] Least time between two looks at the state, and the period while a command runs."""
ANNOUNCE_WITHIN = 5.0
"""[s] for one change of the listing; a lookup service that hangs must not keep the others from the next
one."""

PAUSE = 0.1
"""[s] for which lines of a log are collected."""

REVISIONS = 1 << 20
"""Revisions of its listing for each stay of a robot in a host: those of a later stay are higher."""

WAITERS = 5
"""Callers of waiting commands that a state names."""

SHOWN = 1000
"""[bytes] of one value of declared state, encoded, that a description shows."""

_log = logging.getLogger(__name__)


class Publisher:
    """Publishes what one robot shows. Lives on the event loop."""

    def __init__(
        self,
        runtime: RobotRuntime,
        hooks: Hooks,
        transport: Transport,
        shared: Shared,
        registrar: Registrar | None,
        streams: Streams,
    ) -> None:
        """Prepare; `begin` publishes.

        Args:
            runtime: the robot.
            hooks: of the robot, for its readings.
            transport: where its state is published.
            shared: its state is published in rounds of its process while nothing changes.
            registrar: where it is listed while nobody has enslaved it; None: nowhere.
            streams: what it sends to those who watch it.
        """
        self._streams = streams
        self._refused = ""
        """What was logged last of the roles that it cannot lend."""
        self._runtime, self._hooks, self._transport = runtime, hooks, transport
        self._registrar, self._host = registrar, shared.host
        self._isolation: Isolation = shared.isolation
        self._address = runtime.address
        self._loop = asyncio.get_running_loop()
        self._shown = 0.0
        """[s] When it was last looked at whether the state is another one."""
        self._published = (b"", 0.0)
        """The state that was published last, and when [s]."""
        self._timer: asyncio.TimerHandle | None = None
        """For the next state after a change, or while a command runs."""
        self._rounds = shared.rounds
        self._leave_rounds: Undo | None = None
        self._stopped = True
        self._wanted: Listing | None = None
        self._present: Listing | None = None
        self._listing: asyncio.Task[None] | None = None
        self._closed = False
        self._attributes: dict[str, str] = {}
        """As they were when they were shown last."""
        self._same: tuple[State, bytes] | None = None
        """The state that was published last, if only a change of the robot can make another one, but for its
        readings."""
        self._line = 0
        """Number of the line of the log that was published last."""
        runtime.on_news = lambda: soon(self._loop, self._hurry)  # from any thread, as lines of the log
        soon_published = partial(self._loop.call_later, PAUSE, self._publish_log)
        runtime.log.on_line = lambda: soon(self._loop, soon_published)

    def begin(self) -> None:
        """Publish from now on."""
        self._stopped = False
        self._leave_rounds = self._rounds.add(self._repeat)
        gate = self._runtime.here.gate
        if gate.owner is not None:  # other users of the machine may see some kinds alone
            gate.kinds_of[self._address.name] = self._runtime.kinds
        self._beat()

    def stop(self) -> None:
        """Publish no more, after the last lines of the log."""
        self._publish_log()
        self._stopped = True
        self._runtime.here.gate.kinds_of.pop(self._address.name, None)
        if self._leave_rounds is not None:
            self._leave_rounds()
        if self._timer is not None:
            self._timer.cancel()

    def _hurry(self) -> None:
        """Publish as soon as the last time is long enough ago."""
        if self._timer is None and not self._stopped:
            self._timer = self._loop.call_at(self._shown + QUICK, self._beat)

    def _repeat(self) -> None:
        if self._timer is None:
            self._beat()

    def _beat(self) -> None:
        self._timer = None
        if self._stopped:
            return
        try:
            self._runtime.keep_to_policy()
            busy = self._show()
        except TransportError:  # the transport is closed
            self.stop()
            return
        self._shown = self._loop.time()
        if busy:
            self._timer = self._loop.call_at(self._shown + QUICK, self._beat)

    def _show(self) -> bool:
        """Publish state and listing if they may have changed, else the same state; return if it is busy."""
        robot = self._runtime.robot
        attributes = dict(robot.attributes)
        dirty, self._runtime.has_news = self._runtime.has_news or attributes != self._attributes, False
        self._attributes = attributes
        if dirty:
            self._same = None
            self.update_listing()
        elif self._same is not None and not self._hooks.own_readings:
            self._tell(self._same[1])
            return False
        return self._publish()

    def _tell(self, body: bytes) -> None:
        """Publish a state, unless it has just been published."""
        (before, when), now = self._published, self._loop.time()
        if body != before or now >= when + ROUND / 2:
            self._published = body, now
            self._transport.publish(f"{self._address.key}/state", body)

    def _publish(self) -> bool:
        """Publish how it is now; return whether it is busy."""
        before, self._same = self._same, None
        try:
            if before is None:
                state = self.state()
            else:
                self._runtime.look_at_robot()
                state = msgspec.structs.replace(before[0], readings=self._readings())
            body = encode(state)
            self._tell(body)
        except TransportError:
            raise
        except Exception:  # noqa: BLE001 # an author's code may be behind it
            _log.exception("%s has no state to publish", self._address.name)
            return False
        if not state.busy:
            self._same = state, body
        return bool(state.busy)

    # -- log --------------------------------------------------------------------------------------

    def _publish_log(self) -> None:
        lines = tuple(self._runtime.log.since(self._line))
        if lines:
            self._line = lines[-1].number
            with contextlib.suppress(TransportError):  # it is closed
                self._transport.publish(f"{self._address.key}/log", encode(LogLines(lines=lines)))

    # -- listing ----------------------------------------------------------------------------------

    def update_listing(self) -> None:
        """Have the lookup services hold what they should: nothing while the robot is enslaved, or ends."""
        if self._registrar is None:
            return
        self._wanted = None if self._closed else self.listing()
        if self._listing is None and self._wanted != self._present:
            self._listing = self._loop.create_task(self._change(self._registrar))

    async def listed(self) -> None:
        """Wait until the lookup services know what they should, or as many of them as answer."""
        while self._listing is not None:
            await asyncio.wait([self._listing])

    def withdraw(self) -> None:
        """Take it out of the lookup services for good, whatever changes from now on; see `listed`."""
        self._closed = True
        self.update_listing()

    async def _change(self, registrar: Registrar) -> None:
        try:
            while self._wanted != self._present:
                wanted = self._wanted
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(ANNOUNCE_WITHIN):
                        await self._apply(registrar, wanted)
                self._present = wanted
        finally:
            self._listing = None

    async def _apply(self, registrar: Registrar, wanted: Listing | None) -> None:
        try:
            if wanted is None:
                await registrar.leave(self._address)
            else:
                await registrar.enter(wanted)
        except VrError as error:
            _log.warning("%s: %s", self._address.name, error)

    # -- what it shows ----------------------------------------------------------------------------

    def description(self) -> RobotDescription:
        """Describe the robot as it is now."""
        runtime, readings = self._runtime, self._readings()
        runtime.look_at_robot()
        now, streams = runtime.process.runner.now(), self._streams.specs()
        flows = runtime.traffic.flows(now)
        placement, lends = runtime.placement, tuple(self._lends())

        def describe(state: RobotState) -> RobotDescription:
            bond = None
            if lease := state.lease.current:
                left = max(lease.expires - now, 0.0)
                bond = BondSpec(
                    parent=lease.parent,
                    slot=lease.slot,
                    epoch=lease.epoch,
                    remaining=left,
                    away=lease.away,
                )
            return RobotDescription(
                commands=runtime.specs(state),
                slots=tuple(_with_flow(slot, state, flows) for slot in state.slots.specs()),
                placement=placement,
                placed=state.placing.why,
                advice=runtime.advice,
                bond=bond,
                readings=readings,
                units={str(name): str(unit) for name, unit in runtime.robot.reading_units.items()},
                page=runtime.page,
                isolation=self._isolation,
                unchecked=runtime.unchecked,
                faults=self._hooks.faults,
                kept=self._kept(state.fields),
                streams=streams,
                lends=lends,
                calls=dict(state.calls.counts),
                identity=runtime.identity,
                witness=runtime.robot.witness,
                doc=self._doc(),
                **self._identity(),
                **self._condition(state),
            )

        return runtime.look(describe)

    def state(self) -> State:
        """Return how the robot is now, with its readings."""
        runtime, readings = self._runtime, self._readings()
        runtime.look_at_robot()
        runtime.enter_asked()

        def describe(state: RobotState) -> State:
            lease, calls, now = state.lease.current, state.calls, runtime.process.runner.now()
            running = calls.live.get(calls.running)
            return State(
                caller="" if running is None else running.caller,
                waiters=tuple(calls.live[key].caller for key in calls.waiting[:WAITERS]),
                note="" if running is None else runtime.progress_of(running.key)[1],
                bond=None if lease is None else lease.parent,
                away=None if lease is None or not lease.away else max(lease.expires - now, 0.0),
                readings=readings,
                **self._condition(state),
            )

        return runtime.look(describe)

    def listing(self) -> Listing | None:
        """Return what a lookup service should hold of it: nothing while it is enslaved.

        A service that lends roles stays listed, for those who play them find it there.
        """
        roles = self._lends()
        if self._runtime.lease is not None and not roles:
            return None
        specs = self._runtime.look(self._runtime.specs)
        return Listing(
            commands=tuple(spec.name for spec in specs if spec.available),
            doc=self._doc().partition("\n")[0],
            roles=roles,
            revision=self._runtime.look(lambda state: state.moves) * REVISIONS,
            **self._identity(),
        )

    def _lends(self) -> dict[str, str]:
        """Return the texts of the roles that it lends, by their names in its page.

        They are looked at here, too, for a page may set others while it runs; it lends none then.
        """
        robot = self._runtime.robot
        if not isinstance(robot, Service):
            return {}
        before, self._refused = self._refused, ""
        try:
            return expect_lendable(f"{type(robot).__name__}.lends", robot.lends)
        except TypeError as error:
            self._refused = f"it lends no roles: {error}"
            if self._refused != before:
                self._runtime.log.say("warning", self._refused)
            return {}

    def _condition(self, state: RobotState) -> dict[str, Any]:
        """Return the fields that its description and its state share."""
        calls, stop, control = state.calls, state.stop, state.control
        running = calls.live.get(calls.running)
        return {
            "busy": "" if running is None else running.command,
            "waiting": len(calls.waiting),
            "epoch": state.lease.epoch,
            "online": self._runtime.robot.online,
            "stopped": bool(stop.in_force),
            "stop_reason": stop.in_force,
            "stops": stop.generation,
            "abandoned": tuple(calls.abandoned.values()),
            "paused": state.pause.in_force,
            "held": self._runtime.held_step(),
            "on_way": self._runtime.on_way,
            "advised": self._runtime.advised,
            "in_doubt": self._runtime.in_doubt,
            "drill": self._runtime.drill,
            "operator": control.holder.person,
            "operator_since": control.since if control.holder.person else 0.0,
            "wanted_by": control.asks.person,
            "offered_to": control.offered,
            "hands": control.hands,
            "asks": next((call.doubt for call in calls.live.values() if call.doubt), ""),
        }

    def _readings(self) -> dict[str, float]:
        readings = dict(self._hooks.readings())
        fraction = self._runtime.progress_of(self._runtime.look(lambda state: state.calls.running))[0]
        if not math.isnan(fraction):
            readings["progress"] = fraction
        return readings

    def _kept(self, fields: dict[str, Any]) -> dict[str, Any]:
        """Return the declared state as far as it is small enough to show to everybody."""
        robot = self._runtime.robot
        if not isinstance(robot, VirtualRobot):
            return {}
        declared = robot.field_values.fields
        names = [name for name in fields if isinstance(declared.get(name), StateField)]
        return {name: fields[name] for name in names if len(msgspec.msgpack.encode(fields[name])) <= SHOWN}

    def _doc(self) -> str:
        return _cleaned(type(self._runtime.robot).__doc__ or "")

    def _identity(self) -> dict[str, Any]:
        robot = self._runtime.robot
        return {
            "address": self._address,
            "kinds": robot.kinds(),
            "host": self._host,
            "attributes": {str(name): str(value) for name, value in robot.attributes.items()},
        }


def _with_flow(slot: SlotSpec, state: RobotState, flows: Mapping[str, Flow]) -> SlotSpec:
    """Return a slot with the way to the child in it, and what goes to and fro."""
    bond = state.slots[slot.name].bond
    if bond is None:
        return slot
    calls, size = flows.get(bond.child.key, NO_FLOW)
    return msgspec.structs.replace(
        slot, round_trip=round(bond.lease.round_trip, 6), calls=round(calls, 2), bytes=round(size)
    )


@lru_cache(1024)
def _cleaned(doc: str) -> str:
    return inspect.cleandoc(doc)
