"""Tele-operation: jog by key in bounded steps, watch forces and picture, work the gripper."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from math import degrees
from typing import TYPE_CHECKING, Any, cast

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Grid, Horizontal, Vertical
from textual.widgets import Button, Static

from robotree.tui.composing.gathering import Felt
from robotree.tui.screen.jog import AXES, GET_INFO, GO_TO, GRIP, STEPS, Bounds, Jog
from robotree.tui.screen.key_guard import SOON
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.cameras import Cameras, PictureView
from robotree.tui.screen.widgets.marks import status_mark, tint
from robotree.tui.screen.widgets.readings import Readings, ShownReadings
from robotree.tui.seen import instruments
from robotree.tui.seen.store import OLD
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription

MOVE_LIMIT = 20.0
"""[s] that one step may take: at the slowest speed the largest lead_limit is done in half of that."""

GAUGES = 0.1
"""[s] between two drawings of the readings."""

LIT = 0.3
"""[s] that the button of a pressed key is lit."""

FAR = 0.003
"""[m] from the target at which a robot that rests counts as held back; tracking errors are below 1 mm."""

FELT, HIGH = 3.0, 15.0
"""[N] from which on a force is shown, and shown in red: the arm's controller bounds it at 35 N."""

OLD_NEWS = 1.5
"""[s] after our own movement in which the robot's state may still speak of it."""

PAD = (
    ("", "↑ +x", "", "⇞ +z"),
    ("← +y", "", "→ -y", ""),
    ("", "↓ -x", "", "⇟ -z"),
)
"""Where the buttons lie: x is forward, y to the left, z up, as the robot's frame has them."""

JOGS = {
    "↑ +x": ("x", 1), "↓ -x": ("x", -1), "← +y": ("y", 1), "→ -y": ("y", -1),
    "⇞ +z": ("z", 1), "⇟ -z": ("z", -1), "↶ ,": ("twist", 1), "↷ .": ("twist", -1),
}  # fmt: skip


class TeleopPage(Page):
    """One robot, by hand."""

    KEYS_OF = "teleop"

    def __init__(self, robot: RobotDescription, bounds: Bounds) -> None:
        """Tele-operate a robot within the bounds of its `go_to`."""
        super().__init__()
        self.robot = robot
        self.jog = Jog(bounds)
        self._refusal = ""
        self._cancelled = False
        """Whether the running command was cancelled from here."""
        self._cancels = 0
        """How often a person has cancelled here: a key that was pressed before has no effect any more."""
        self._dropped: dict[str, float] = {}
        """[m] or [rad] by axis that the presses of the last moment could not add to the target."""
        self.felt: list[Felt] = []
        """What the robot has read after each grip."""
        self._rested_at = 0.0
        """[s] When the last of our movements ended."""

    def title_of_page(self) -> str:
        """Return the robot's name."""
        return f"{self.robot.name} / tele-operation"

    def parts(self) -> ComposeResult:
        """The state over the whole width; pad and gauges on the left, the picture on the right."""
        yield CachedText(id="state")
        with Horizontal(classes="columns"):
            with Vertical(classes="pad-side"):
                with Grid(classes="pad"):
                    for row in PAD:
                        for label in row:
                            yield _jog_button(label) if label else Static("")
                with Horizontal(classes="pad-row"):
                    for label in ("↶ ,", "↷ ."):
                        yield _jog_button(label)
                    yield CachedText(id="step")
                yield Readings(id="gauges")
            with Vertical(classes="picture-side"):
                yield Cameras()
                yield PictureView(id="picture")

    def on_mount(self) -> None:
        """Draw the gauges more often than the rest, and look at the workspace."""
        self.query_one("#gauges").border_title = "readings"
        self.set_interval(GAUGES, self.guarded(self._draw_gauges))
        self.query_one(Cameras).attach(self.query_one(PictureView))
        self.jog.choice = min(self.app.steps.get(self.robot.name, self.jog.choice), len(STEPS) - 1)
        self.draw()

    # -- keys and buttons --------------------------------------------------------------------------

    def action_jog(self, axis: str, direction: int) -> None:
        """Move one axis by one step."""
        self._light(axis, direction)
        self._press(axis, direction, self._cancels)

    def _light(self, axis: str, direction: int) -> None:
        """Light the button of a key for a moment."""
        label = next(one for one, jog in JOGS.items() if jog == (axis, direction))
        for button in self.query(".jog").results(Button):
            if str(button.label) == label:
                button.add_class("-lit")
                self.set_timer(LIT, partial(button.remove_class, "-lit"))

    @on(Button.Pressed, ".jog")
    def _jog_pressed(self, event: Button.Pressed) -> None:
        self.action_jog(*JOGS[str(event.button.label)])

    def action_resize(self, by: int) -> None:
        """Choose a larger or a smaller step."""
        self.jog.resize(by)
        self.app.steps.choose(self.robot.name, self.jog.choice)
        self.draw()

    def action_cancel(self) -> None:
        """Cancel all that the robot does, and what was still wanted."""
        self.jog.drop()
        self._cancelled = True
        self._cancels += 1
        self.app.do("cancel", NAME=self.robot.name)

    def action_camera(self) -> None:
        """Look through the next camera."""
        self.query_one(Cameras).turn()

    @work(exit_on_error=False, group="grip", exclusive=True)
    async def action_grip(self, action: str) -> None:
        """Open or close the gripper."""
        refusal = await self._ask(GRIP, {"action": action})
        self._tell(refusal)
        if not refusal:
            with suppress(VrError):  # what is not known is not said
                info = await self.app.realm_client.call(self.robot.name, GET_INFO, {}, deadline=5.0)
                if isinstance(info, Mapping):
                    self.felt.append(Felt(self.robot.name, time.time(), cast("Mapping[str, Any]", info)))

    @work(exit_on_error=False, group="press")
    async def _press(self, axis: str, direction: int, cancels: int) -> None:
        actual = await self._actual()
        if actual is None or cancels != self._cancels:
            return
        state = self.app.store.state(self.robot.name)
        rested = self.app.now() - self._rested_at > OLD_NEWS
        if state and state.busy and rested and not self.jog.moving:
            self.jog.drop()  # somebody else moves it: the next step starts where that ends
        if dropped := self.jog.press(axis, direction, actual):
            self._dropped[axis] = self._dropped.get(axis, 0.0) + dropped
            self.set_timer(SOON, partial(self._tell_dropped, dict(self._dropped)))
        self._go()

    def _tell_dropped(self, dropped: Mapping[str, float]) -> None:
        """Tell what of the last presses was dropped, unless more was dropped meanwhile."""
        if dropped != self._dropped:
            return
        self._dropped = {}
        ways = ", ".join(_way(axis, way) for axis, way in dropped.items())
        self.app.tell(
            f"{ways} dropped: {self.robot.name} is as far behind as it may be, or at a bound", "warning"
        )

    async def _actual(self) -> Mapping[str, float] | None:
        """Return where the robot is: from its readings, or by asking it."""
        readings = self.app.store.readings(self.robot.name)
        if set(AXES) <= readings.keys():
            return readings
        try:
            info = await self.app.realm_client.call(self.robot.name, GET_INFO, {}, deadline=5.0)
        except VrError as error:
            self._tell(str(error))
            return None
        pose = cast("dict[str, Any]", info) if isinstance(info, Mapping) else {}
        if set(AXES) <= pose.keys():
            return {axis: float(pose[axis]) for axis in AXES}
        self._tell(f"{self.robot.name}.{GET_INFO} does not return x, y, z and twist")
        return None

    @work(exit_on_error=False, group="go", exclusive=False)
    async def _go(self) -> None:
        """Carry out the newest target, then the one that came meanwhile; never two at a time."""
        while target := self.jog.take():
            self._cancelled = False
            refusal = await self._ask(GO_TO, target)
            self._rested_at = self.app.now()
            if refusal and self._cancelled:
                self.jog.drop()
                refusal = ""  # the person who cancelled need not be told
            elif refusal:
                rest = self._short()
                self.jog.drop()
                refusal += f"; the last {_way('', rest)} of the way are dropped" if rest > FAR else ""
            else:
                self.jog.arrived()
            self._tell(refusal)

    async def _ask(self, command: str, arguments: Mapping[str, Any]) -> str:
        """Have a command carried out; return why not, or nothing."""
        try:
            await self.app.realm_client.call(self.robot.name, command, arguments, deadline=MOVE_LIMIT)
        except VrError as error:
            return str(error)
        return ""

    def _tell(self, refusal: str) -> None:
        self._refusal = refusal
        if refusal:
            self.app.tell(refusal, "error")
        self.draw()

    # -- drawing -----------------------------------------------------------------------------------

    def _draw_gauges(self) -> None:
        if self.is_active:
            self.query_one("#state", CachedText).show(self._state_line())
            shown = ShownReadings.of(self.app.store, self.robot.name, self.app.now())
            self.query_one(Readings).draw(shown)

    def draw(self) -> None:
        """Draw the step and the target."""
        super().draw()
        muted, strong = tint(self.app, "muted"), tint(self.app, "primary", bold=True)
        step = Text.assemble(
            ("  step ", muted),
            (f"{1000 * self.jog.step('x'):.0f} mm", strong),
            (" · ", muted),
            (f"{degrees(self.jog.step('twist')):.0f}°", strong),
        )
        self.query_one("#step", CachedText).show(step)
        self.query_one("#state", CachedText).show(self._state_line())
        self.query_one(Cameras).draw()

    def _short(self) -> float:
        """[m] How far the robot is from the target."""
        readings = self.app.store.readings(self.robot.name)
        return self.jog.short(readings) if set(AXES) <= readings.keys() else 0.0

    def _state_line(self) -> Text:
        """Return how the robot is, in one bold line: stopped, refused, moving, held back, or holding."""
        store, name, now = self.app.store, self.robot.name, self.app.now()
        how, readings, short = store.status(name, now), store.readings(name), self._short()
        error, accent = tint(self.app, "error", bold=True), tint(self.app, "accent", bold=True)
        force = instruments.size(readings) or 0.0
        line = Text(" ", "bold", overflow="ellipsis")
        if how in OLD | {"stopped"}:
            line.append_text(status_mark(self.app, how, store.doing(name, now)))
            line.append("  ")
        elif self._refusal:
            line.append(f"✗ {self._refusal}  ", error)
        if self.jog.moving:
            line.append(f"◐ moving  {_way('', short)} to go  ", accent)
        elif self.jog.target is not None and short > FAR:
            line.append(f"✗ {_way('', short)} short  ", error)
        elif len(line) == 1:
            rests = "holds" if self.jog.target else "at rest; press a key to move"
            line.append(f"● {rests}  ", tint(self.app, "success", bold=True))
        if force >= FELT:
            line.append(f"{'✗ ' if force >= HIGH else ''}{force:.0f} N  ", error if force >= HIGH else "bold")
        if self._dropped:
            line.append(f"! {', '.join(_way(*one) for one in self._dropped.items())} dropped  ", error)
        if self.jog.target is not None:
            x, y, z, twist = (self.jog.target[axis] for axis in AXES)
            x, y, z = (round(value, 3) + 0.0 for value in (x, y, z))  # no -0.000
            turn = round(degrees(twist)) + 0
            line.append(f"to x {x:.3f}  y {y:.3f}  z {z:.3f} m  {turn}°", "bold")
        line.rstrip()
        return line


def _way(axis: str, length: float) -> str:
    """Return a length along an axis [m], or an angle [rad], as one steps it: `12 mm of x`, `10° of twist`."""
    text = f"{degrees(length):.0f}°" if axis == "twist" else f"{1000 * length:.0f} mm"
    return f"{text} of {axis}" if axis else text


def _jog_button(label: str) -> Button:
    button = Button(Text(label), classes="jog", compact=True)
    button.can_focus = False
    return button
