"""What a key does before its verb is carried out: ask for what is missing, ask back where it is dangerous."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from robotree.tui import grammar
from robotree.tui.actions import BY_VERB, Where, shapes
from robotree.tui.grammar import Line
from robotree.tui.screens.dialogs import Confirm
from robotree.tui.screens.enslave import EnslaveDialog, Opening, ReleaseDialog, openings
from robotree.tui.screens.new import NewPage
from robotree.tui.screens.panel import PanelPage

if TYPE_CHECKING:
    from robotree.tui.app import Supervisor

Ask = Callable[["Supervisor", str, str], None]
"""Takes the supervisor, the selected robot and the selected slot; either may be empty."""

MADE = "VirtualRobot"
"""Kind of the robots that can be deleted from here: the others are processes of their own."""


def _panel(app: Supervisor, name: str, _slot: str) -> None:
    robot = app.store.descriptions.get(name)
    if robot is None:
        app.tell(f"{name} has not described itself yet" if name else "no robot is selected", "warning")
    else:
        app.push_screen(PanelPage(robot))


def _create(app: Supervisor, _name: str, _slot: str) -> None:
    app.push_screen(NewPage())


def _enslave(app: Supervisor, name: str, slot: str) -> None:
    found = openings(app.store, name)
    places = [one for one in found if not slot or (one.parent, one.slot) == (name, slot)]
    if not places:
        why = f"{name} has no empty slot and none waits for it" if name else "no robot is selected"
        app.tell(f"{why}; `n` makes a virtual robot that could take it", "warning")
        return
    _offer(app, places, "" if any(one.parent == name for one in places) else name)


def _offer(app: Supervisor, places: list[Opening], child: str) -> None:
    def answered(line: Line | None) -> None:
        if line:
            app.perform(line)

    app.push_screen(EnslaveDialog(app.store, places, child), answered)


def _release(app: Supervisor, name: str, slot: str) -> None:
    robot = app.store.descriptions.get(name)
    held = [(f"{name}.{one.name}", one.child.name) for one in robot.slots if one.child] if robot else []
    chosen = [path for path, _ in held if not slot or path == f"{name}.{slot}"]
    bond = robot.bond if robot else None
    if chosen and (slot or len(chosen) == 1):
        confirm_line(app, Line("release", {"PARENT.SLOT": chosen[0]}))
    elif chosen:
        app.push_screen(ReleaseDialog(held), lambda line: confirm_line(app, line) if line else None)
    elif bond:
        confirm_line(app, Line("release", {"PARENT.SLOT": f"{bond.parent.name}.{bond.slot}"}))
    else:
        app.tell(f"{name} holds nobody" if name else "no robot is selected", "warning")


def _delete(app: Supervisor, name: str, _slot: str) -> None:
    robot = app.store.descriptions.get(name)
    if robot is None:
        app.tell("no robot is selected", "warning")
    elif MADE not in robot.kinds:
        app.tell(f"{name} stands for a real robot: end its proxy where it runs", "warning")
    elif robot.bond:
        app.tell(
            f"{name} is enslaved by {robot.bond.parent.name}: delete that one, or release it first", "warning"
        )
    else:
        confirm_line(app, Line("delete", {"NAME": name}))


def _quit(app: Supervisor, _name: str, _slot: str) -> None:
    if not app.farewell:
        app.exit(0)
        return

    def answered(answer: bool | None) -> None:  # noqa: FBT001 # Textual gives the screen's result
        if answer:
            app.exit(0)

    app.push_screen(Confirm("Leave ?", app.farewell, "Leave"), answered)


def _resume(app: Supervisor, _name: str, _slot: str) -> None:
    if not app.store.stopped:
        app.tell("no robot is in protective stop", "plain")
    else:
        confirm_line(app, Line("resume"))


def _about_robot(verb: str) -> Ask:
    def ask(app: Supervisor, name: str, _slot: str) -> None:
        if name:
            app.do(verb, NAME=name)
        else:
            app.tell("no robot is selected", "warning")

    return ask


def confirm_line(app: Supervisor, line: Line) -> None:
    """Ask back, then carry out."""
    written = grammar.form(line, shapes(Where.PROMPT))
    dialog = Confirm(f"{written} ?", _consequence(app, line), line.verb.capitalize())

    def answered(answer: bool | None) -> None:  # noqa: FBT001 # Textual gives the screen's result
        if answer:
            app.perform(line)

    app.push_screen(dialog, answered)


def _consequence(app: Supervisor, line: Line) -> str:
    store = app.store
    match line.verb:
        case "delete":
            robot = store.descriptions.get(line.text("NAME"))
            children = [slot.child.name for slot in robot.slots if slot.child] if robot else []
            busy = f" It is carrying out {robot.busy}, which ends." if robot and robot.busy else ""
            freed = f" {', '.join(children)} will be free again." if children else ""
            return f"{line.text('NAME')} ends for good.{busy}{freed}"
        case "release":
            return "The child stops what it does for its parent, and is listed again."
        case "resume":
            return f"{', '.join(store.stopped) or 'All robots'} may move again when commanded. Is all clear?"
        case _:
            return BY_VERB[line.verb].help


ASK: Mapping[str, Ask] = {
    "panel": _panel,
    "create": _create,
    "enslave": _enslave,
    "release": _release,
    "delete": _delete,
    "resume": _resume,
    "show": _about_robot("show"),
    "cancel": _about_robot("cancel"),
    "stop": lambda app, _name, _slot: app.action_protective_stop(),
    "help": lambda app, _name, _slot: app.action_show_help(),
    "quit": _quit,
    "robots": lambda app, _name, _slot: app.main.show_pane("robots"),
    "tree": lambda app, _name, _slot: app.main.show_pane("tree"),
    "views": lambda app, _name, _slot: app.main.show_pane("views"),
    "log": lambda app, _name, _slot: app.main.show_pane("log"),
}
"""By verb; those that open the prompt belong to the main page."""
