"""The panel of Patrol: how often it has driven, at which place it is, and a round more with each press."""

from rich.text import Text
from textual.app import ComposeResult
from textual.widgets import Button, ProgressBar, Static

from robotree.tui.panels.author import Refused, RobotPanel

ROUNDS = (1, 2, 5)


class PatrolPanel(RobotPanel):
    """Rounds to choose from, and how far they are."""

    TITLE = "Patrol"
    DEFAULT_CSS = "PatrolPanel Button { margin: 0 1 0 0; }"

    def compose(self) -> ComposeResult:
        """The state, a bar, and a button for each number of rounds."""
        yield Static(id="where")
        yield ProgressBar(total=1.0, show_eta=False, id="bar")
        for rounds in ROUNDS:
            yield Button(f"{rounds} round{'s' * (rounds > 1)}", id=f"rounds-{rounds}", compact=True)

    def on_mount(self) -> None:
        """Say what is known."""
        self.said = "it goes to where its next rover is"
        self.query_one(Button).focus()
        self.draw()

    def see(self) -> None:
        """Show the newest readings."""
        self.query_one(ProgressBar).update(progress=self.readings.get("progress", 0.0))
        self.draw()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """Go on patrol."""
        self.run_worker(self.patrol(int(str(event.button.id).removeprefix("rounds-"))), exit_on_error=False)

    async def patrol(self, rounds: int) -> None:
        """Go, and say how many legs that were in all."""
        self.said = f"on patrol, {rounds} rounds"
        self.draw()
        try:
            self.said = f"{await self.call('patrol', rounds=rounds)} legs in all"
        except Refused as error:
            self.said = str(error)
        self.draw()

    def draw(self) -> None:
        """Draw the two places, and what was said."""
        self.query_one("#where", Static).update(Text(f"near ●───────────● far    {self.status}\n{self.said}"))
