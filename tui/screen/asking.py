"""Questions before a key acts: for missing values, and whether a dangerous verb is meant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from robotree.tui.errors import SupervisorError
from robotree.tui.line import grammar
from robotree.tui.line.action import About, Where
from robotree.tui.line.actions import BY_VERB, shapes
from robotree.tui.line.going import trip_to
from robotree.tui.line.grammar import Blank, Line
from robotree.tui.processes.place_files import COORDINATES
from robotree.tui.screen.operator_app import OperatorApp
from robotree.tui.screen.pages.compose import ComposePage
from robotree.tui.screen.pages.dialogs import Choosing, Confirm, Reading
from robotree.tui.screen.pages.enslave import EnslaveDialog, Opening, openings
from robotree.tui.screen.pages.going import GoDialog, NameDialog
from robotree.tui.screen.pages.group import GroupPanel
from robotree.tui.screen.pages.help import help_text
from robotree.tui.screen.pages.main import PANES, in_front, main_page
from robotree.tui.screen.pages.messages import MessagesPage
from robotree.tui.screen.pages.new import NewPage
from robotree.tui.screen.pages.orders import OrdersPage
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.pages.permits import PermitsPage
from robotree.tui.screen.pages.readings import ReadingsPage
from robotree.tui.screen.pages.where import WherePage
from robotree.tui.screen.widgets.prompt import Kind
from robotree.tui.seen import wording
from robotree.tui.seen.frames import frame_of
from robotree.tui.seen.selection import Place
from robotree.tui.seen.store import Store
from robotree.tui.words import say

if TYPE_CHECKING:
    from textual.screen import Screen

    from robotree.vr.base.description import RobotDescription

Ask = Callable[[OperatorApp, Place], object]
"""Takes the supervisor, and what is selected: a robot, an empty slot, or nothing."""

SHARE = 10
"""[%] by which a key makes the part below the list, or the picture in it, larger."""

HELP = "help"
"""Title of the help."""

NOBODY = "no robot is selected"

PLACEMENTS = {
    "manual": "people alone move it",
    "advise": "it says where it would be better off",
    "auto": "it moves there by itself",
}
"""Who decides where a robot is, for people."""

MADE = "VirtualRobot"
"""Kind of the robots that can be deleted from here: the others are processes of their own."""


def _panel(app: OperatorApp, place: Place) -> None:
    name = place.name
    if app.store.group(name):
        app.push_screen(GroupPanel(name, app.store))
        return
    if place.slot and not name:  # what one wants of an empty slot is to fill it
        _enslave(app, place)
        return
    robot, absent = app.store.descriptions.get(name), app.store.absent.get(name)
    lost = app.store.rebond(name)
    if lost:
        _rebond(app, *lost)
    elif absent:
        what, key = " hangs" if absent.hangs else "", app.keymap.spelled("dismiss")
        app.tell(f"{name}{what}: {absent.remedy}, or {key} takes it off the list", "warning")
    elif app.store.is_away(name):
        app.push_screen(PanelPage(app.store.away[name].robot))
    elif robot is None:
        app.tell(f"{name} has not described itself yet" if name else NOBODY, "warning")
    else:
        app.push_screen(PanelPage(robot))


def _rebond(app: OperatorApp, parent: str, slot: str, child: str) -> None:
    """Offer to bind a child again that was lost and is back; who declines is not asked again."""
    places = [opening for opening in openings(app.store, parent) if opening.slot == slot]

    def answered(line: Line | None) -> None:
        if line:
            app.perform(line)
        else:
            app.store.lost.pop((parent, slot), None)

    app.push_screen(EnslaveDialog(app.store, places, child), answered)


def _set(app: OperatorApp, place: Place) -> None:
    if app.store.group(place.name):
        app.push_screen(GroupPanel(place.name, app.store, "set"))
        return
    robot = app.store.descriptions.get(place.name)
    if robot is None or not wording.settings(robot):
        app.tell(f"{place.name} has no settings" if place.name else NOBODY, "warning")
    else:
        app.push_screen(PanelPage(robot, "set"))


def _of_robots(ask: Callable[[OperatorApp, Place, RobotDescription], None]) -> Ask:
    """Ask what concerns one robot that has described itself; a group, and nothing, is told apart."""

    def asked(app: OperatorApp, place: Place) -> None:
        robot = app.store.descriptions.get(place.name)
        if not _is_group(app, place):
            if robot is None:
                app.tell(NOBODY, "warning")
            else:
                ask(app, place, robot)

    return asked


def _is_group(app: OperatorApp, place: Place) -> bool:
    """Whether a group is selected, which is told then: what the key asks for concerns one robot."""
    if found := bool(app.store.group(place.name)):
        app.tell(f"{place.name} is a group: select one of its members for that", "warning")
    return found


def plainly(verb: str) -> Ask:
    """Return how a verb is carried out for what is selected: nothing is to be asked about it."""
    action = BY_VERB[verb]
    blank = next((one.name for one in action.shape.parts if isinstance(one, Blank)), "")

    def ask(app: OperatorApp, place: Place) -> None:
        if action.about is About.NOTHING:
            app.do(verb)
        elif not place.name:
            app.tell(NOBODY, "warning")
        elif action.members or not _is_group(app, place):
            app.do(verb, **{blank: place.name})

    return ask


def ask_for(app: OperatorApp, verb: str, place: Place) -> None:
    """Do what the key of a verb does first."""
    (ASK.get(verb) or plainly(verb))(app, place)


def _show(app: OperatorApp, place: Place) -> None:
    if app.store.group(place.name):
        app.do("groups", GROUP=place.name)
    else:
        plainly("show")(app, place)


def _enslave(app: OperatorApp, place: Place) -> None:
    if _is_group(app, place):
        return
    name, slot = place.name, ""
    if place.slot and not name:
        name, slot = place.parent, place.slot
    found = openings(app.store, name)
    places = [one for one in found if not slot or (one.parent, one.slot) == (name, slot)]
    if not places:
        why = f"{name} has no empty slot and none waits for it" if name else NOBODY
        app.tell(f"{why}; {app.keymap.spelled('create')} makes a virtual robot that could take it", "warning")
        return
    _offer(app, places, "" if any(one.parent == name for one in places) else name)


def _offer(app: OperatorApp, places: list[Opening], child: str) -> None:
    app.ask(EnslaveDialog(app.store, places, child), app.perform)


def _release(app: OperatorApp, place: Place) -> None:
    if _is_group(app, place):
        return
    name, slot = place.name, ""
    if place.slot and name:
        name, slot = place.parent, place.slot
    robot = app.store.descriptions.get(name)
    slots = robot.slots if robot else ()
    held = [(f"{name}.{one.name}", each.name) for one in slots if (each := one.child or one.watched)]
    chosen = [path for path, _ in held if not slot or path == f"{name}.{slot}"]
    bond = robot.bond if robot else None
    if chosen and (slot or len(chosen) == 1):
        confirm_line(app, Line("release", {"PARENT.SLOT": chosen[0]}))
    elif chosen:
        which = Choosing("Release which child?", [(path, f"holds {child}") for path, child in held])
        app.ask(which, lambda path: confirm_line(app, Line("release", {"PARENT.SLOT": path})))
    elif bond:
        confirm_line(app, Line("release", {"PARENT.SLOT": f"{bond.parent.name}.{bond.slot}"}))
    else:
        app.tell(f"{name} has no child" if name else NOBODY, "warning")


def _delete(app: OperatorApp, place: Place) -> None:
    if app.marks:
        _delete_marked(app)
        return
    name = place.name
    if app.store.group(name):
        confirm_line(app, Line("group", {"GROUP": name, "--delete": True}))
        return
    robot = app.store.descriptions.get(name)
    if robot is None:
        app.tell(NOBODY, "warning")
    elif MADE not in robot.kinds:
        what = {"yes": "a simulated robot", "no": "a real robot"}.get(
            robot.attributes.get("simulated", ""), "a robot"
        )
        app.tell(f"{name} stands for {what}: end its proxy where it runs", "warning")
    elif robot.bond:
        app.tell(
            f"{name} is enslaved by {robot.bond.parent.name}: delete that one, or release it first", "warning"
        )
    else:
        confirm_line(app, Line("delete", {"NAME": name}))


def _delete_marked(app: OperatorApp) -> None:
    """Ask back once for all marked robots; those of which none can be deleted are left out."""
    robots = [app.store.descriptions.get(name) for name in sorted(app.marks)]
    names = [robot.name for robot in robots if robot and MADE in robot.kinds and not robot.bond]
    left = sorted(app.marks.difference(names))
    if not names:
        app.tell(f"none of {', '.join(left)} can be deleted: they are no free virtual robots", "warning")
        return
    hidden = sorted(set(names) - {placement.name for placement in main_page(app).shown})
    consequence = f"They end for good: {', '.join(names)}."
    consequence += f" Hidden by the filter: {', '.join(hidden)}." if hidden else ""
    consequence += f" Left as they are: {', '.join(left)}." if left else ""

    def delete(_yes: str) -> None:
        main_page(app).unmark()
        for name in names:
            app.do("delete", NAME=name)

    app.ask(Confirm(say("delete {count} marked robots?", count=len(names)), consequence, "Delete"), delete)


def _cancel(app: OperatorApp, place: Place) -> None:
    names = sorted(app.marks) or [place.name]
    for name in names:
        plainly("cancel")(app, Place(name))
    main_page(app).unmark()


def _quit(app: OperatorApp, _place: Place) -> None:
    if app.farewell:
        app.ask(Confirm(say("Leave?"), app.farewell, "Leave"), lambda _yes: app.exit(0))
    else:
        app.exit(0)


def _stop(app: OperatorApp, _place: Place) -> None:
    app.tell("protective stop is on its way to every robot", "warning")
    app.do("stop")


def _help(app: OperatorApp, _place: Place) -> None:
    front = app.screen
    if isinstance(front, Reading) and front.heading == HELP:
        front.dismiss()  # the key that opened it closes it
    else:
        app.push_screen(Reading(HELP, help_text(app)))


def _resume(app: OperatorApp, _place: Place) -> None:
    if settled := app.store.settle_stop():
        app.tell(f"settled: {', '.join(settled)} had not confirmed the stop, and is not stopped", "warning")
    if app.store.stopped:
        confirm_line(app, Line("resume"))
    elif not settled:
        app.tell("no robot is in protective stop", "plain")


class Danger(NamedTuple):
    """What is asked back before a dangerous verb is carried out."""

    consequence: Callable[[Store, Line], str]
    """What will be, as sentences; it may be empty."""
    outlived: Callable[[Store, Line], Callable[[], str]] | None = None
    """Makes what finds out that the question is none any more: it is answered, or about another robot."""
    question: str = "{line}?"
    yes: str = ""
    """The word on the button; empty: the verb."""


def confirm_line(app: OperatorApp, line: Line) -> None:
    """Ask back, then carry out."""
    danger = DANGERS.get(line.verb, Danger(_helps))
    outlived = danger.outlived(app.store, line) if danger.outlived else str

    def carry_out(_yes: str) -> None:
        if why := outlived():
            app.tell(why, "warning")  # it has just become another question
        else:
            app.perform(line)

    question = danger.question.format(line=grammar.form(line, shapes(Where.PROMPT)), name=line.text("NAME"))
    consequence = danger.consequence(app.store, line)
    app.ask(Confirm(question, consequence, danger.yes or line.verb.capitalize(), outlived), carry_out)


def _helps(_store: Store, line: Line) -> str:
    return BY_VERB[line.verb].help


def _ungroups(_store: Store, line: Line) -> str:
    return f"{line.text('GROUP')} is a name no more; its robots stay as they are."


def _resumes(store: Store, _line: Line) -> str:
    return f"{', '.join(store.stopped) or 'All robots'} may move again when commanded. Is all clear?"


def _resumed(store: Store, line: Line) -> Callable[[], str]:
    asked = {one for one in store.stopped if line.text("NAME") in {"", one}}

    def outlived() -> str:
        if not asked or not asked.isdisjoint(store.stopped):
            return ""
        return f"no need to resume: the stop of {', '.join(sorted(asked))} has ended meanwhile"

    return outlived


def _deletes(store: Store, line: Line) -> str:
    name = line.text("NAME")
    robot = store.descriptions.get(name)
    children = [slot.child.name for slot in robot.slots if slot.child] if robot else []
    condition = store.state(name) or robot  # a state is newer than a description
    busy = f" It is carrying out {condition.busy}, which ends." if condition and condition.busy else ""
    freed = f" {', '.join(children)} will be free again." if children else ""
    return f"{name} ends for good.{busy}{freed}"


def _replaced(store: Store, line: Line) -> Callable[[], str]:
    name = line.text("NAME")
    before = store.descriptions.get(name)

    def outlived() -> str:
        now = store.descriptions.get(name)
        if before is None or (now and now.address == before.address):
            return ""
        return f"{name} is another robot now: look, then ask again" if now else f"{name} has gone meanwhile"

    return outlived


def _releases(store: Store, line: Line) -> str:
    parent, _, slot = line.text("PARENT.SLOT").partition(".")
    child = _child(store, parent, slot) or "The child"
    return f"{child} stops what it does for {parent}, and can be commanded by others again."


def _changed_hands(store: Store, line: Line) -> Callable[[], str]:
    parent, _, slot = line.text("PARENT.SLOT").partition(".")
    before = _child(store, parent, slot)

    def outlived() -> str:
        now = _child(store, parent, slot)
        if not before or now == before:
            return ""
        return f"{parent}.{slot} {f'holds {now}' if now else 'is empty'} now, not {before}"

    return outlived


def _child(store: Store, parent: str, slot: str) -> str:
    """Return the child in a slot; empty: none, or unknown."""
    robot = store.descriptions.get(parent)
    slots = robot.slots if robot else ()
    inhabitants = (one.child or one.watched for one in slots if one.name == slot)
    return next((each.name for each in inhabitants if each), "")


def _takes_control(store: Store, line: Line) -> str:
    state = store.state(line.text("NAME"))
    holder = state.operator if state else ""
    return f"{holder} has control, and loses it; what {holder} has begun ends." if holder else ""


DANGERS: Mapping[str, Danger] = {
    "resume": Danger(_resumes, _resumed),
    "delete": Danger(_deletes, _replaced),
    "release": Danger(_releases, _changed_hands),
    "group": Danger(_ungroups),
    "control take": Danger(_takes_control, question="Take control of {name}?", yes="Take control"),
}
"""By verb: what is asked back; of another dangerous verb, whether its help is meant."""


def _take_control(app: OperatorApp, place: Place) -> None:
    if not place.name:
        app.tell(NOBODY, "warning")
        return
    robot = app.store.state(place.name) or app.store.descriptions.get(place.name)
    seen = {"--seen": str(robot.hands)} if robot else {}
    confirm_line(app, Line("control take", {"NAME": place.name, **seen}))


def _restart(app: OperatorApp, place: Place) -> None:
    """Start the process of a robot that has gone again: its own, or that of its host."""
    if _is_group(app, place):
        return
    absent = app.store.absent.get(place.name)
    if not place.name:
        app.tell(NOBODY, "warning")
    elif absent is None:
        app.tell(f"{place.name} answers: only what has gone is started again", "warning")
    elif absent.hangs:
        app.tell(f"{place.name} hangs: {absent.remedy}, then start it again", "warning")
    else:
        app.do("restart", NAME=absent.host or place.name)


def _page(make: Callable[[], Screen[None]]) -> Ask:
    return lambda app, _place: app.push_screen(make())


def _page_of_robot(make: Callable[[str], Screen[None]]) -> Ask:
    def ask(app: OperatorApp, place: Place) -> None:
        if not place.name:
            app.tell(NOBODY, "warning")
        elif not _is_group(app, place):
            app.push_screen(make(place.name))

    return ask


def _dismiss(app: OperatorApp, place: Place) -> None:
    if app.store.dismiss(place.name):
        app.tell(f"{place.name} is off the list; it is back as soon as it answers")
    else:
        app.tell(
            f"{place.name} answers: only a robot that hangs or has gone can be dismissed"
            if place.name
            else NOBODY,
            "warning",
        )


def _pane(name: str) -> Ask:
    return lambda app, _place: in_front(app).show_pane(name)


def _role(app: OperatorApp, place: Place) -> None:
    group = app.store.group(place.name)
    members = [app.store.descriptions.get(name) for name in (group.members if group else (place.name,))]
    robot = members[0] if members else None
    each = [one.attributes.get("roles", "").split() if one else [] for one in members]
    known = [role for role in each[0] if all(role in other for other in each)] if each else []
    if not known:
        app.tell(f"{place.name} plays no roles" if place.name else NOBODY, "warning")
        return

    playing = robot.attributes.get("role", "") if robot else ""
    app.ask(
        Choosing(
            f"Which role does {place.name} play from its next act on?",
            [(role, "now" if role == playing else "") for role in known],
            at=playing,
        ),
        lambda role: app.do("role", NAME=place.name, ROLE=role),
    )


def _migrate(app: OperatorApp, _place: Place, robot: RobotDescription) -> None:
    others = [name for name in app.store.taking_hosts if name != robot.host]
    if not robot.host:
        app.tell(f"{robot.name} is a proxy, and stays where its controller is", "warning")
    elif not others:
        app.tell("no other host takes robots; `robotree host NAME` starts one that does", "warning")
    else:
        app.ask(
            Choosing(
                f"Where does {robot.name} go on? It is on {robot.host}.",
                [(host, "") for host in sorted(others)],
            ),
            lambda host: app.do("migrate", NAME=robot.name, HOST=host),
        )


def _go(app: OperatorApp, place: Place, robot: RobotDescription) -> None:
    front, readings = main_page(app), app.store.readings(place.name)
    point = front.point if app.screen is front else None
    frame = front.ground if point is not None else frame_of(robot)
    if frame != frame_of(robot):
        app.foresee(robot, point or {}, frame)
        newest = app.foresight.newest
        app.tell("" if newest is None else newest.refusal, "warning")
        return
    here = {name: readings[name] for name in COORDINATES if name in readings}
    try:
        trip = trip_to(robot, here | (point or {}), readings)
    except SupervisorError as error:
        app.tell(str(error), "warning")
        return

    def answered(line: Line | None) -> None:
        if line:
            app.perform(line)  # the way stays on the plan while the robot takes it
        else:
            app.foresight.forget()

    app.push_screen(GoDialog(robot, trip, frame), answered)


def _keep(app: OperatorApp, place: Place, robot: RobotDescription) -> None:
    front, readings = main_page(app), app.store.readings(place.name)
    point = front.point if app.screen is front else None
    if point is not None and front.ground != frame_of(robot):
        of = front.ground or "no frame"
        app.tell(
            f"{robot.name} moves in another frame, and the point is of {of}; choose a robot of it", "warning"
        )
        return
    if point is not None:  # what nobody points at stays as it is: the height and the twist of the tool
        point = {name: readings[name] for name in COORDINATES if name in readings} | point
    app.ask(NameDialog(place.name, point, frame_of(robot)), app.perform)


def _place(app: OperatorApp, _place: Place, robot: RobotDescription) -> None:
    if not robot.host:
        app.tell(f"{robot.name} is a proxy, and stays where its controller is", "warning")
        return
    state = app.store.state(robot.name)
    advised = state.advised if state else robot.advised
    unknown = "nobody has looked yet" + ": choose advise" * (robot.placement == "manual")
    choices = [(word, what + " (now)" * (word == robot.placement)) for word, what in PLACEMENTS.items()]
    move = f"move to {advised} now"
    if advised:
        choices.insert(0, (move, ""))

    def chosen(word: str) -> None:
        if word == move:
            app.do("migrate", NAME=robot.name, HOST=advised)
        else:
            app.do("place", NAME=robot.name, PLACEMENT=word)

    app.ask(Choosing(f"{robot.name} is on {robot.host}", choices, note=robot.advice or unknown), chosen)


def _line(kind: Kind, text: str = "") -> Ask:
    def ask(app: OperatorApp, _place: Place) -> None:
        front = app.screen
        if isinstance(front, Page):
            front.open_line(kind, text)
        else:  # what is typed now is meant for the prompt
            app.guard.opened_by_itself(front, typed=True)
            app.tell("a question or a text is in front: esc leaves it, then type the verb", "warning")

    return ask


ASK: Mapping[str, Ask] = {
    "panel": _panel,
    "compose": _page(ComposePage),
    "create": _page(NewPage),
    "set": _set,
    "migrate": _of_robots(_migrate),
    "place": _of_robots(_place),
    "enslave": _enslave,
    "release": _release,
    "delete": _delete,
    "go": _of_robots(_go),
    "places add": _of_robots(_keep),
    "show": _show,
    "where": _page_of_robot(WherePage),
    "restart": _restart,
    "readings": _page(ReadingsPage),
    "messages": _page_of_robot(MessagesPage),
    "cancel": _cancel,
    "stop": _stop,
    "resume": _resume,
    "role": _role,
    "say": _line("verb", "say "),
    "control take": _take_control,
    "orders": _page(OrdersPage),
    "permits": _page(PermitsPage),
    "help": _help,
    "quit": _quit,
    "filter": _line("filter"),
    "prompt": _line("verb"),
    "tree": lambda app, _place: in_front(app).sort("tree"),
    "sort": lambda app, _place: in_front(app).sort(),
    "joints": lambda app, _place: in_front(app).unfold(),
    "divide": lambda app, _place: in_front(app).divide(),
    "larger": lambda app, _place: in_front(app).share(SHARE),
    "smaller": lambda app, _place: in_front(app).share(-SHARE),
    "broader": lambda app, _place: in_front(app).share_picture(SHARE),
    "narrower": lambda app, _place: in_front(app).share_picture(-SHARE),
    "view next": lambda app, _place: in_front(app).next_filter(),
    "view use": lambda app, place: in_front(app).use_filter(place.name),
    "view save": lambda app, place: in_front(app).save_filter(place.name),
    "view drop": lambda app, place: in_front(app).drop_filter(place.name),
    "wide": lambda app, _place: in_front(app).widen(),
    "mark": lambda app, place: in_front(app).mark(place.name),
    "unmark": lambda app, _place: in_front(app).unmark(),
    "dismiss": _dismiss,
    "level": lambda app, _place: in_front(app).raise_level(),
    "skeleton": lambda app, _place: in_front(app).set_bare(),
    "together": lambda app, _place: in_front(app).set_side_by_side(),
    "camera": lambda app, _place: in_front(app).turn(),
    "theme": lambda app, _place: app.looks.change("theme"),
    "language": lambda app, _place: app.looks.change("language"),
    **{name: _pane(name) for name in PANES},
}
"""By verb: what its key does first, where that is not to carry it out for what is selected (`plainly`)."""
