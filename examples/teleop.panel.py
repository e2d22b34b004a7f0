"""The panel of TeleOp: an arm by hand, with the keys of the supervisor's own tele-operation page.

The arrows move the gripper in the plane, page up and page down lift and lower it, `,` and `.` turn it, `+`
and `-` choose the step, `o` and `O` open and close the fingers, `h` halts. Presses add up to a target
that is never far ahead of the arm (`robotree.tui.screen.jog`); one movement runs at a time.
"""

from math import degrees
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Grid, Horizontal, Vertical
from textual.widgets import Button, Static

from robotree.tui.panels.author import PanelCamera, Refused, RobotPanel
from robotree.tui.screen.jog import AXES, Jog, bounds

PAD = {
    "left": ("← +y", "y", 1),
    "up": ("↑ +x", "x", 1),
    "down": ("↓ -x", "x", -1),
    "right": ("→ -y", "y", -1),
    "pageup": ("⇞ +z", "z", 1),
    "pagedown": ("⇟ -z", "z", -1),
    "comma": ("↶ ,", "twist", 1),
    "full_stop": ("↷ .", "twist", -1),
}
"""Label, axis and direction of each key: x is forward, y to the left, z up, as the arm's frame has them."""


class HandDrive(RobotPanel, can_focus=True):
    """Jog by key in bounded steps, and look."""

    TITLE = "Arm by hand"
    DEFAULT_CSS = """
    HandDrive { layout: horizontal; }
    HandDrive #hand { width: 34; }
    HandDrive Grid { grid-size: 4 2; grid-rows: 1; height: 3; }
    HandDrive Button { min-width: 8; width: 8; }
    HandDrive #state { height: 4; }
    """
    BINDINGS: ClassVar = [
        *((key, f"jog('{axis}', {way})", label) for key, (label, axis, way) in PAD.items()),
        ("plus", "resize(1)", "larger step"),
        ("minus", "resize(-1)", "smaller step"),
        ("o", "grip('open')", "open"),
        ("O", "grip('close')", "close"),
        ("h", "halt", "halt"),
    ]

    def compose(self) -> ComposeResult:
        """Pad and state on the left, the picture on the right."""
        with Horizontal():
            with Vertical(id="hand"):
                yield Static(id="state")
                with Grid():
                    for key, (label, _, _) in PAD.items():
                        button = Button(Text(label), id=f"pad-{key}", compact=True)
                        button.can_focus = False
                        yield button
                yield Static("+ - step   o O fingers   h halt")
            yield PanelCamera("cell.wrist")

    def on_mount(self) -> None:
        """Wait for the first key."""
        self.jog, self.said = Jog(bounds(self.robot) or {}), "press a key to move"
        self.focus()
        self.draw()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """A click on the pad is the key that stands on it."""
        _, axis, way = PAD[str(event.button.id).removeprefix("pad-")]
        self.action_jog(axis, way)

    def action_resize(self, by: int) -> None:
        """Choose a larger or a smaller step."""
        self.jog.resize(by)
        self.draw()

    def action_jog(self, axis: str, direction: int) -> None:
        """Add one step to the target."""
        self.run_worker(self.step(axis, direction), exit_on_error=False)

    async def step(self, axis: str, direction: int) -> None:
        """Move the target from where the arm is, and go there unless a movement runs: that goes on to it."""
        try:
            here = await self.call("get_info")
            dropped = self.jog.press(axis, direction, {one: here[one] for one in AXES})
            self.said = f"{axis} is as far ahead as it may be" if dropped else ""
            while target := self.jog.take():
                self.draw()
                await self.call("go_to", **target)
                self.jog.arrived()
        except Refused as error:
            self.jog.drop()
            self.said = str(error)
        self.draw()

    def action_grip(self, action: str) -> None:
        """Open or close the fingers."""
        self.ask("grip", action=action)

    def action_halt(self) -> None:
        """End what runs, and forget the target."""
        self.jog.drop()
        self.ask("halt")

    def refused(self, reason: str) -> None:
        """Show why a command was not carried out."""
        self.said = reason
        self.draw()

    def draw(self) -> None:
        """Show the step, the target, and what was said last."""
        line = Text(
            f"step {1000 * self.jog.step('x'):.0f} mm · {degrees(self.jog.step('twist')):.0f}°\n", "bold"
        )
        line.append("moving\n" if self.jog.moving else "holds\n" if self.jog.target else "at rest\n")
        if (target := self.jog.target) is not None:
            line.append("to " + " ".join(f"{axis} {target[axis]:.3f}" for axis in "xyz") + "\n")
        line.append(self.said, "red" if self.said else "")
        self.query_one("#state", Static).update(line)
