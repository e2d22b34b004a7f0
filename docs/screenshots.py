"""Takes the pictures of the full screen: the real supervisor over the real demo, as SVG.

    python docs/screenshots.py [SCENE …] [--size SIZE] [--out FOLDER] [--png]

Without a name all scenes are taken, into `docs/screens/NAME-SIZE.svg`, and the one for the README into
`docs/supervisor.svg`. `--png` writes a PNG beside each with `rsvg-convert`, to be looked at. It starts the
demo's processes in a realm of its own, puts virtual robots on its robots as an operator would, and presses
keys.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from rich.segment import Segment
from svg import svg
from textual._compositor import LayoutUpdate
from textual.pilot import Pilot
from textual.strip import Strip

from robotree.client.joining import joined
from robotree.tui.demo import cast
from robotree.tui.line.actions import BY_VERB
from robotree.tui.processes.alarm_file import alarms_of
from robotree.tui.processes.crew import Crew
from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.user_app import UserApp
from robotree.tui.seen.selection import Place
from robotree.tui.wire.security import realm_key
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import VrError
from robotree.vr.supervision.realm_client import RealmClient

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
REALM = "demo"
SIZES = {"200x60": (200, 60), "120x34": (120, 34), "80x24": (80, 24), "40x20": (40, 20)}
"""Of which each page has a picture."""
SIXTEEN = "16-colours"
OF_COLOURS = {SIXTEEN: (80, 24)}
REDUCED = {SIXTEEN: 16}
"""Number of colours, where they are not all."""
TERMINAL = "tty3"
"""At which the person sits who presses the keys."""
LOOKING = re.compile("looking through|is listened to")
"""Instead of a picture, or of messages, that have not come yet."""
SETTLED = 1.5
"""[s] for what was asked for to be drawn, and for what moves to be on its way."""
README = ("lever", (120, 30))
"""Scene and size of the README's picture."""


@dataclass
class Stage:
    """What a scene has to play with."""

    realm_client: RealmClient
    app: Supervisor
    pilot: Pilot[int]

    async def key(self, verb: str) -> None:
        """Press the key of a verb."""
        await self.pilot.press(BY_VERB[verb].key)

    async def open(self, verb: str, robot: str = "") -> None:
        """Do what a key does with a robot selected."""
        self.app.ask_for(verb, Place(robot))
        await self.settle()

    async def settle(self) -> None:
        """Let the screen come to rest."""
        await self.pilot.pause(SETTLED)


Scene = Callable[[Stage], Awaitable[None]]
SCENES: dict[str, tuple[Scene, tuple[str, ...]]] = {}


def scene(*more: str) -> Callable[[Scene], Scene]:
    """Enter a scene, under the name of its function, at each size and at these."""

    def keep(play: Scene) -> Scene:
        SCENES[play.__name__.replace("_", "-")] = (play, (*SIZES, *more))
        return play

    return keep


@scene(SIXTEEN)
async def lever(stage: Stage) -> None:
    """The lever closes: three robots work together."""
    stage.app.run_typed("call lever.close")
    await stage.settle()


@scene(SIXTEEN)
async def stopped(stage: Stage) -> None:
    """Everything was stopped while the lever opened."""
    stage.app.run_typed("call lever.open")
    await stage.pilot.pause(1.0)
    await stage.key("stop")
    await stage.settle()


@scene()
async def panel(stage: Stage) -> None:
    """The form of a command."""
    await stage.open("panel", "mover")


@scene()
async def teleoperation(stage: Stage) -> None:
    """The arm is driven by hand."""
    await stage.realm_client.release("mover", "arm")
    await stage.settle()
    stage.app.open_teleoperation(await stage.realm_client.describe("arm-1"))
    await stage.settle()
    await stage.pilot.press("w", "w")
    await stage.settle()


@scene()
async def create(stage: Stage) -> None:
    """A virtual robot is about to be made."""
    await stage.open("create")


@scene()
async def compose(stage: Stage) -> None:
    """A virtual robot is put together without code."""
    await stage.open("compose")


@scene()
async def enslave(stage: Stage) -> None:
    """A robot is about to get a child."""
    with contextlib.suppress(VrError):
        await stage.realm_client.release("mover", "arm")
    await stage.settle()
    await stage.open("enslave", "mover")


@scene()
async def messages(stage: Stage) -> None:
    """What crosses the wire of the arm."""
    await stage.open("messages", "arm-1")
    await stage.pilot.pause(3.0)


@scene()
async def orders(stage: Stage) -> None:
    """What robots that are away will find."""
    await stage.open("orders")


@scene()
async def confirm(stage: Stage) -> None:
    """A question before something is taken away."""
    await stage.open("delete", "square")


@scene()
async def prompt(stage: Stage) -> None:
    """A verb is being typed."""
    await stage.key("prompt")
    await stage.pilot.press(*"call", "space", *"m")
    await stage.settle()


@scene()
async def log(stage: Stage) -> None:
    """All that happened."""
    for line in (
        "call lever.close",
        "cancel lever",
        "call mover.get_info",
        "call square.move_square length=9",
        "stop",
        "resume",
    ):
        stage.app.perform(stage.app.prompt.parse(line.split()))
        await stage.pilot.pause(0.5)
    await stage.open("log")


@scene(SIXTEEN)
async def readings(stage: Stage) -> None:
    """Readings over time, with an alarm, while the arm moves."""
    for name in ("x", "z", "fz"):
        stage.app.tick(("arm-1", name))
    stage.app.choose("arm-1")
    stage.app.run_typed("alarm below arm-1.z 0.35")
    stage.app.run_typed("call lever.close")
    await stage.key("readings")
    await stage.pilot.pause(6.0)


@scene()
async def where(stage: Stage) -> None:
    """Where the lever is in its page."""
    stage.app.run_typed("call lever.close")
    await stage.pilot.pause(3.0)
    await stage.open("where", "lever")
    await stage.pilot.pause(2.0)


@scene()
async def parts(stage: Stage) -> None:
    """The list in parts by state, while the lever closes."""
    stage.app.run_typed("call lever.close")
    for _ in range(3):
        await stage.key("divide")
    await stage.settle()


@scene()
async def views(stage: Stage) -> None:
    """The pictures of the workspace."""
    await stage.open("views")


@scene(SIXTEEN)
async def plan(stage: Stage) -> None:
    """The place of the arm from above, with two named places and the way to the cursor."""
    await at_the_plan(stage)


@scene()
async def going(stage: Stage) -> None:
    """The arm is about to be sent somewhere, and says which way it would take."""
    await at_the_plan(stage)
    await stage.pilot.press("enter")
    await stage.settle()


async def at_the_plan(stage: Stage) -> None:
    """Free the arm, name two places, and move the cursor of the plan."""
    with contextlib.suppress(VrError):  # the scene before has
        await stage.realm_client.release("mover", "arm")
    for line in ("places add shelf of arm-1 x=0.35 y=0.25 z=0.3", "places add tray of arm-1 x=0.2 y=-0.35"):
        await stage.app.attempt(stage.app.prompt.parse(line.split()))
    stage.app.choose("arm-1")
    await stage.key("plan")
    await stage.settle()
    await stage.pilot.press(*["up"] * 4, *["left"] * 6)
    await stage.settle()


@scene()
async def together(stage: Stage) -> None:
    """All cameras side by side, and a point in one of them."""
    with contextlib.suppress(VrError):
        await stage.realm_client.release("mover", "arm")
    stage.app.choose("arm-1")
    await stage.open("views")
    await stage.key("together")
    await stage.settle()
    await stage.pilot.press("down", "down", "down")
    await stage.settle()


@scene()
async def help(stage: Stage) -> None:  # noqa: A001 # the scene is named after the verb
    """All keys."""
    await stage.open("help")


@scene()
async def user(stage: Stage) -> None:
    """What people see who do not operate robots."""
    stage.app.perform(stage.app.prompt.parse(["call", "lever.close"]))
    await stage.settle()


@scene()
async def doing(stage: Stage) -> None:
    """The form of something that can be done."""
    await stage.pilot.press("down", "enter")
    await stage.settle()


FOR_USERS = frozenset({"user", "doing"})
"""Scenes of the page for users."""


async def prepare(realm_client: RealmClient) -> None:
    """Put virtual robots on top of the demo's."""
    for file, name in (
        ("move_square.py", "square"),
        ("move_to.py", "mover"),
        ("open_close_lever.py", "lever"),
    ):
        await realm_client.create(str(EXAMPLES / file), name)
    for parent, slot, child in (
        ("square", "rover", "rover-1"),
        ("mover", "arm", "arm-1"),
        ("lever", "mover", "mover"),
    ):
        await realm_client.enslave(parent, slot, child)


async def tidy(realm_client: RealmClient) -> None:
    """Bring back what a scene has changed, and wait until nothing moves."""
    for robot in await realm_client.tree():
        if robot.stopped:
            await realm_client.resume(None)
            await realm_client.orders.release("")
            break
    await realm_client.cancel("lever")
    alarms_of(REALM).change(lambda alarms: alarms.clear())
    mover = (await realm_client.describe("mover")).slot("arm")
    if mover is not None and mover.child is None:
        await realm_client.enslave("mover", "arm", "arm-1")


async def take(
    realm_client: RealmClient, name: str, size: tuple[int, int], path: Path, *, colours: int = 0
) -> None:
    """Play a scene and write its picture."""
    terminal = {
        "TERM": "xterm-16color" if colours == 16 else "xterm-256color",
        "COLORTERM": "" if colours else "truecolor",
    }
    os.environ.update(terminal)
    app = (UserApp if name in FOR_USERS else Supervisor)(realm_client, realm=REALM)
    async with app.run_test(size=size) as pilot:
        stage = Stage(realm_client, app, pilot)
        while not (app.store.joined and len(app.screen_stack) > 1):
            await pilot.pause(0.05)
        await stage.settle()
        await SCENES[name][0](stage)
        for _ in range(100):
            if not any(LOOKING.search(strip.text) for strip in strips(app)):
                break
            await pilot.pause(0.1)
        text = svg(strips(app), f"robotree: {name}", colours=colours)
        await asyncio.to_thread(path.write_text, text, encoding="utf-8")
        app.exit(0)


def strips(app: Supervisor) -> list[Strip]:
    """Return what is to be seen, with the pages behind a dialog."""
    # as Textual's own screenshot does it
    behind = app._background_screens  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    compositor = app.screen._compositor  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    shown = compositor.render_update(full=True, screen_stack=behind)
    if not isinstance(shown, LayoutUpdate):
        raise TypeError("a full update of the screen is no layout any more")
    return [_without_folder(Strip.join(parts)) for parts in shown.strips]


def _without_folder(line: Strip) -> Strip:
    """Name the folder of the project as everyone may have it: where it was taken says nothing."""
    path = re.compile(re.escape(str(HERE.parent)) + r"(\S*)")

    def short(found: re.Match[str]) -> str:
        return f"~/robotree{found[1]}".ljust(len(found[0]))

    return Strip([Segment(path.sub(short, text), style, control) for text, style, control in line])


async def shoot(names: list[str], size: str, folder: Path) -> list[Path]:
    """Take the pictures of these scenes at a size, or at all; return where they are."""
    await asyncio.to_thread(folder.mkdir, parents=True, exist_ok=True)
    async with Crew(REALM, key=str(realm_key(REALM))) as crew:
        await cast(crew)
        async with joined(REALM) as realm_client:
            with sitting_at(TERMINAL):
                return await play(realm_client, names, size, folder)


async def play(realm_client: RealmClient, names: list[str], only: str, folder: Path) -> list[Path]:
    """Play the scenes of these names; return where their pictures are."""
    taken: list[Path] = []
    await prepare(realm_client)
    for name in names:
        for label in SCENES[name][1]:
            if only not in {"", label}:
                continue
            path = folder / f"{name}-{label}.svg"
            size = (SIZES | OF_COLOURS)[label]
            await take(realm_client, name, size, path, colours=REDUCED.get(label, 0))
            await tidy(realm_client)
            taken.append(path)
    if README[0] in names and not only:
        await take(realm_client, *README, folder.parent / "supervisor.svg")
        taken.append(folder.parent / "supervisor.svg")
    return taken


def main() -> None:
    """Take the pictures that the command line names."""
    reader = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    reader.add_argument("scene", nargs="*", choices=[*SCENES, []], help="all, if none is named")
    reader.add_argument("--size", default="", choices=[*SIZES, *OF_COLOURS], help="only this one")
    reader.add_argument("--out", type=Path, default=HERE / "screens", help="folder of the pictures")
    reader.add_argument("--png", action="store_true", help="a PNG beside each, made by rsvg-convert")
    given = reader.parse_args()
    with tempfile.TemporaryDirectory(prefix="rt-") as apart:  # no realm and no state of the user's
        os.environ.update(XDG_RUNTIME_DIR=apart, XDG_STATE_HOME=apart)
        for path in asyncio.run(shoot(given.scene or list(SCENES), given.size, given.out)):
            sys.stdout.write(f"{path}\n")
            if given.png:
                picture = str(path.with_suffix(".png"))
                subprocess.run(["rsvg-convert", str(path), "-o", picture], check=True)  # noqa: S607


if __name__ == "__main__":
    main()
