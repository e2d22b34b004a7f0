"""Tele-operation: jog by key in bounded steps, watch forces and picture, work the gripper."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import TYPE_CHECKING, Any, ClassVar, cast

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Grid, Horizontal, Vertical
from textual.widgets import Button, Static

from robotree.tui.screen.bindings import bindings
from robotree.tui.screen.jog import AXES, Bounds, Jog
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.teleoperable import GET_INFO, GO_TO, GRIP
from robotree.tui.screen.widgets.cameras import Cameras
from robotree.tui.screen.widgets.gauges import Gauges
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.picture import PictureView
from robotree.tui.screen.widgets.still import Still
from robotree.vr.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.description import RobotDescription

MOVE_LIMIT = 20.0
"""[s] that one step may take: at the slowest speed the largest leash is done in half of that."""

GAUGES = 0.1
"""[s] between two drawings of the readings."""

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

    KEYS_OF: ClassVar[str] = "teleop"
    BINDINGS: ClassVar[list[BindingType]] = bindings(KEYS_OF)

    def __init__(self, robot: RobotDescription, bounds: Bounds) -> None:
        """Tele-operate a robot within the bounds of its `go_to`."""
        super().__init__()
        self.robot = robot
        self.jog = Jog(bounds)
        self._refusal = ""
        self._rested_at = 0.0
        """[s] When the last of our movements ended."""

    def title_of_page(self) -> str:
        """Return the robot's name."""
        return f"{self.robot.name} / tele-operation"

    def parts(self) -> ComposeResult:
        """Pad and gauges on the left, the picture on the right."""
        with Horizontal(classes="columns"):
            with Vertical(classes="pad-side"):
                with Grid(classes="pad"):
                    for row in PAD:
                        for label in row:
                            yield _jog_button(label) if label else Static("")
                with Horizontal(classes="pad-row"):
                    for label in ("↶ ,", "↷ ."):
                        yield _jog_button(label)
                    yield Still(id="step")
                yield Gauges(id="gauges", in_degrees=True)
                yield Still(id="wish")
            with Vertical(classes="picture-side"):
                yield Cameras()
                yield PictureView(id="picture")

    def on_mount(self) -> None:
        """Draw the gauges more often than the rest, and look at the workspace."""
        self.query_one("#gauges").border_title = "readings"
        self.set_interval(GAUGES, self.fenced(self._draw_gauges))
        self.query_one(Cameras).attach(self.query_one(PictureView))

    # -- keys and buttons --------------------------------------------------------------------------

    def action_jog(self, axis: str, direction: int) -> None:
        """Move one axis by one step."""
        self._press(axis, direction)

    @on(Button.Pressed, ".jog")
    def _jog_pressed(self, event: Button.Pressed) -> None:
        axis, direction = JOGS[str(event.button.label)]
        self._press(axis, direction)

    def action_resize(self, by: int) -> None:
        """Choose a larger or a smaller step."""
        self.jog.resize(by)
        self.draw()

    def action_cancel(self) -> None:
        """Cancel all that the robot does, and what was still wished."""
        self.jog.drop()
        self.app.do("cancel", NAME=self.robot.name)

    def action_camera(self) -> None:
        """Look through the next camera."""
        self.query_one(Cameras).turn()

    @work(exit_on_error=False, group="grip", exclusive=True)
    async def action_grip(self, action: str) -> None:
        """Open or close the gripper."""
        self._tell(await self._ask(GRIP, {"action": action}))

    @work(exit_on_error=False, group="press")
    async def _press(self, axis: str, direction: int) -> None:
        actual = await self._actual()
        if actual is None:
            return
        state = self.app.store.state(self.robot.name)
        rested = self.app.now() - self._rested_at > OLD_NEWS
        if state and state.busy and rested and not self.jog.moving:
            self.jog.drop()  # somebody else moves it: the next step starts where that ends
        self.jog.press(axis, direction, actual)
        self._go()

    async def _actual(self) -> Mapping[str, float] | None:
        """Return where the robot is: from its readings, or by asking it."""
        readings = self.app.store.readings(self.robot.name)
        if set(AXES) <= readings.keys():
            return readings
        try:
            info = await self.app.fleet.call(self.robot.name, GET_INFO, {}, deadline=5.0)
        except VrError as error:
            self._tell(str(error))
            return None
        told = cast("dict[str, Any]", info) if isinstance(info, Mapping) else {}
        if set(AXES) <= told.keys():
            return {axis: float(told[axis]) for axis in AXES}
        self._tell(f"{self.robot.name}.{GET_INFO} does not tell x, y, z and twist")
        return None

    @work(exit_on_error=False, group="go", exclusive=False)
    async def _go(self) -> None:
        """Carry out the newest wish, then the one that came meanwhile; never two at a time."""
        while target := self.jog.take():
            refusal = await self._ask(GO_TO, target)
            self._rested_at = self.app.now()
            if refusal:
                self.jog.drop()
            else:
                self.jog.arrived()
            self._tell(refusal)

    async def _ask(self, command: str, arguments: Mapping[str, Any]) -> str:
        """Have a command carried out; return why not, or nothing."""
        try:
            with self.app.store.asking(self.robot.name):
                await self.app.fleet.call(self.robot.name, command, arguments, deadline=MOVE_LIMIT)
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
            state = self.app.store.state(self.robot.name)
            store, stale = self.app.store, state is not None and not state.online
            readings, units = store.readings(self.robot.name), store.units(self.robot.name)
            self.query_one(Gauges).draw(readings, units, stale=stale)

    def draw(self) -> None:
        """Draw the step and the wish."""
        super().draw()
        muted, strong = tint(self.app, "muted"), tint(self.app, "primary", bold=True)
        step = Text.assemble(
            ("  step ", muted),
            (f"{1000 * self.jog.step('x'):.0f} mm", strong),
            (" · ", muted),
            (f"{degrees(self.jog.step('twist')):.0f}°", strong),
        )
        self.query_one("#step", Still).show(step)
        self.query_one("#wish", Still).show(self._wish_line())
        self.query_one(Cameras).draw()

    def _wish_line(self) -> Text:
        muted = tint(self.app, "muted")
        if self._refusal:
            return Text(f"✗ {self._refusal}", tint(self.app, "error"))
        if self.jog.wish is None:
            return Text("● at rest; press a key to move", muted)
        x, y, z, twist = (self.jog.wish[axis] for axis in AXES)
        word = "◐ moving to" if self.jog.moving else "● holds"
        return Text(f"{word}  x {x:.3f}  y {y:.3f}  z {z:.3f} m  {degrees(twist):.0f}°", muted)


def _jog_button(label: str) -> Button:
    button = Button(Text(label), classes="jog", compact=True)
    button.can_focus = False
    return button
