"""The keys of the pages beside the main one: the other half of the registry (`actions`). Pure.

Pages make their bindings from it, the help page its rows, a keymap file finds the names here. A letter has
one meaning in the whole program: on a page it is either the verb of that letter, or belongs to this page
alone (a test compares).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

ENTER = "Into the form, and on to the next field. It never runs anything."
AT_REST = "at the list of commands"
"""Where the letters of a panel are keys: nobody types there."""

_CURSOR = "Move the cursor, with shift by five cells; the robot says which way it would take."


@dataclass(frozen=True, slots=True, kw_only=True)
class PageKey:
    """One key of one page."""

    page: str
    """`attend`, `panel`, `teleop`, `new`, `user`, `doing`, `plan`, `compose`, `question`, `text`."""
    name: str
    """Its action, in a word; `page.name` is its name in a keymap file."""
    key: str
    """As Textual names it; several are separated by commas."""
    action: str
    """The action of the page that Textual calls."""
    help: str
    """One sentence; keys with the same one share a line of the help page."""
    label: str = ""
    """Word beside the key in the footer; empty: not shown there."""
    shown: str = ""
    """How the footer and the help page write the key; empty: as it is printed on keyboards."""
    verb: str = ""
    """The verb of the registry that it is on this page; empty: it belongs to this page alone."""
    needs: str = ""
    """The verb that it uses, where it is not that verb's own key; empty: none."""
    while_busy: bool = False
    """It works while the form in front carries something out (see `Action.while_busy`)."""

    @property
    def id(self) -> str:
        """Its name in a keymap file."""
        return f"{self.page}.{self.name}"

    @property
    def wants(self) -> str:
        """The verb without which it is absent (`Surface.withholds`); empty: it is never."""
        return self.needs or self.verb


def _jog(name: str, key: str, axis: str, direction: int, sentence: str) -> PageKey:
    return PageKey(
        page="teleop", name=name, key=key, action=f"jog('{axis}', {direction})", help=sentence, needs="call"
    )


PAGE_KEYS: tuple[PageKey, ...] = (
    # -- the panel of a robot
    PageKey(
        page="panel",
        name="back",
        key="escape",
        action="back",
        label="Back",
        help="Leave the panel; what runs goes on.",
        while_busy=True,
    ),
    PageKey(
        page="attend",
        name="end",
        key="escape",
        action="end",
        label="End it",
        help="End the command that goes on while a key is held.",
    ),
    PageKey(page="panel", name="form", key="enter", action="fill_in", help=ENTER),
    PageKey(
        page="panel",
        name="run",
        needs="call",
        key="ctrl+r",
        action="run",
        label="Run",
        help="Run the command as it is filled in.",
    ),
    PageKey(page="panel", name="list", key="ctrl+l", action="list", help="Go to the list of commands."),
    PageKey(
        page="panel",
        name="now",
        key="ctrl+n",
        action="follow",
        help="Let the field follow the robot again, after something was typed into it.",
    ),
    PageKey(
        page="panel",
        name="copy",
        key="ctrl+y",
        action="copy",
        label="Copy line",
        help="Copy the command line that does the same as the form.",
        while_busy=True,
    ),
    PageKey(
        page="panel",
        name="teleoperate",
        needs="call",
        key="x",
        action="teleoperate",
        label="Tele-operate",
        help=f"Tele-operate, {AT_REST}.",
    ),
    PageKey(
        page="panel",
        name="cancel",
        key="c",
        action="cancel",
        label="Cancel",
        help=f"Cancel all that the robot does, {AT_REST} or while the form in front runs.",
        verb="cancel",
        while_busy=True,
    ),
    PageKey(
        page="panel",
        name="halt",
        key="exclamation_mark",
        action="halt",
        help=f"Stop this robot alone, or the members of this group, {AT_REST} or while the form runs.",
        shown="!",
        verb="stop",
        while_busy=True,
    ),
    PageKey(
        page="panel",
        name="about",
        key="i",
        action="about",
        help=f"Describe the robot in full, {AT_REST}.",
        verb="show",
    ),
    # -- tele-operation: x is forward, y to the left, z up, as the robot's frame has them
    _jog("forward", "up", "x", 1, "Move forward, back."),
    _jog("back", "down", "x", -1, "Move forward, back."),
    _jog("left", "left", "y", 1, "Move left, right."),
    _jog("right", "right", "y", -1, "Move left, right."),
    _jog("up", "pageup", "z", 1, "Move up, down."),
    _jog("down", "pagedown", "z", -1, "Move up, down."),
    _jog("twist-left", "comma", "twist", 1, "Twist the gripper."),
    _jog("twist-right", "full_stop", "twist", -1, "Twist the gripper."),
    PageKey(
        page="teleop",
        name="larger",
        key="plus,equals_sign",
        action="resize(1)",
        label="Step",
        shown="+",
        help="Larger steps.",
    ),
    PageKey(
        page="teleop",
        name="smaller",
        key="minus",
        action="resize(-1)",
        label="Step",
        shown="-",
        help="Smaller steps.",
    ),
    PageKey(
        page="teleop",
        name="open",
        needs="call",
        key="o",
        action="grip('open')",
        label="Open",
        help="Open the gripper.",
    ),
    PageKey(
        page="teleop",
        name="close",
        needs="call",
        key="O",
        action="grip('close')",
        label="Close",
        help="Close the gripper.",
    ),
    PageKey(
        page="teleop",
        name="cancel",
        key="c",
        action="cancel",
        label="Cancel",
        help="Cancel all that the robot does; it holds where it is.",
        verb="cancel",
    ),
    PageKey(
        page="teleop",
        name="camera",
        key="v",
        action="camera",
        label="Camera",
        help="Look at the next picture of the workspaces.",
        verb="views",
    ),
    PageKey(
        page="teleop",
        name="next",
        key="V",
        action="camera",
        help="Look at the next picture of the workspaces.",
        verb="camera",
    ),
    PageKey(
        page="teleop", name="leave", key="escape", action="dismiss", label="Back", help="Back to the panel."
    ),
    # -- the page for new robots
    PageKey(
        page="new",
        name="leave",
        key="escape",
        action="back",
        label="Back",
        help="Leave the page; a robot that is just being made is made nevertheless.",
        while_busy=True,
    ),
    # -- the page for people who do not operate robots
    PageKey(
        page="user", name="open", key="enter", action="open", label="Choose", help="Open what is chosen."
    ),
    PageKey(
        page="user",
        name="leave",
        key="q",
        action="leave",
        label="Quit",
        help="Leave; what goes on by itself goes on.",
        verb="quit",
    ),
    PageKey(
        page="doing",
        name="back",
        key="escape",
        action="back",
        label="Back",
        help="Back to the list; what runs goes on.",
        while_busy=True,
    ),
    PageKey(
        page="doing",
        name="begin",
        needs="call",
        key="ctrl+r",
        action="begin",
        label="Begin",
        help="Begin, as it is filled in.",
    ),
    PageKey(
        page="writing",
        name="back",
        key="escape",
        action="back",
        label="Back",
        help="Back to the list; what was written is not kept.",
    ),
    PageKey(
        page="writing",
        name="make",
        needs="create",
        key="ctrl+r",
        action="make",
        label="Make it",
        help="Check and make it.",
    ),
    # -- the plan of a place, and a picture that one points into
    PageKey(
        page="plan",
        name="up",
        key="up",
        action="cursor(0, -1)",
        shown="↑ ↓ ← →",
        help="Move the cursor, with shift by five cells; the robot says which way it would take.",
    ),
    *(
        PageKey(page="plan", name=name, key=key, action=f"cursor({across}, {down})", help=_CURSOR, shown=" ")
        for name, key, across, down in (
            ("down", "down", 0, 1),
            ("left", "left", -1, 0),
            ("right", "right", 1, 0),
            ("far-up", "shift+up", 0, -5),
            ("far-down", "shift+down", 0, 5),
            ("far-left", "shift+left", -5, 0),
            ("far-right", "shift+right", 5, 0),
        )
    ),
    PageKey(
        page="plan",
        name="go",
        needs="go",
        key="enter",
        action="choose",
        label="Go there",
        help="Ask before the selected robot goes to the point under the cursor; it says what it would do.",
    ),
    PageKey(
        page="plan",
        name="nearer",
        key="plus,equals_sign",
        action="zoom(1)",
        shown="+",
        help="See less, and larger.",
    ),
    PageKey(page="plan", name="further", key="minus", action="zoom(-1)", help="See more, and smaller."),
    PageKey(page="plan", name="all", key="0", action="zoom(0)", help="See everything that stands there."),
    PageKey(
        page="plan",
        name="next",
        key="right_square_bracket",
        action="robot(1)",
        label="Robot",
        shown="[ ]",
        help="Select the next robot of this place, or the one before.",
    ),
    PageKey(
        page="plan",
        name="previous",
        key="left_square_bracket",
        action="robot(-1)",
        shown=" ",
        help="Select the next robot of this place, or the one before.",
    ),
    # -- the composer
    PageKey(
        page="compose",
        name="add",
        needs="compose",
        key="a",
        action="add",
        label="Add",
        help="Add a step below: a command of a robot, repeat, if, together, part, wait.",
    ),
    PageKey(
        page="compose",
        name="remove",
        needs="compose",
        key="delete",
        action="remove",
        help="Take a step out, and what is in it.",
    ),
    PageKey(
        page="compose",
        name="up",
        needs="compose",
        key="ctrl+up",
        action="move(-1)",
        help="Move a step up, down.",
    ),
    PageKey(
        page="compose",
        name="down",
        needs="compose",
        key="ctrl+down",
        action="move(1)",
        help="Move a step up, down.",
    ),
    PageKey(
        page="compose",
        name="in",
        needs="compose",
        key="right",
        action="nest(1)",
        help="Put a step into the one above, out of it.",
    ),
    PageKey(
        page="compose",
        name="out",
        needs="compose",
        key="left",
        action="nest(-1)",
        help="Put a step into the one above, out of it.",
    ),
    PageKey(
        page="compose",
        name="parametrise",
        needs="compose",
        key="dollar_sign",
        action="parametrise",
        label="Parameter",
        shown="$",
        help="Make a value of the step a parameter.",
    ),
    PageKey(
        page="compose",
        name="show",
        needs="compose",
        key="T",
        action="show",
        label="By hand",
        help="Lead a robot by hand: what it does becomes steps.",
    ),
    PageKey(
        page="compose",
        name="try",
        needs="compose",
        key="f5",
        action="try",
        label="Try",
        help="Carry it out in a twin of the cell, where nothing real moves.",
    ),
    PageKey(
        page="compose",
        name="make",
        needs="compose",
        key="ctrl+r",
        action="make",
        label="Make it",
        help="Write the page, its panel and its test into this folder.",
    ),
    PageKey(
        page="compose",
        name="back",
        key="escape",
        action="back",
        label="Back",
        help="Leave the line that is edited, then the composer.",
    ),
    # -- where a robot is in its page
    PageKey(
        page="where",
        name="back",
        key="escape",
        action="back",
        label="Back",
        help="Back to the list; the robot goes on as it does.",
    ),
    PageKey(
        page="where",
        name="pause",
        key="b",
        action="verb('pause')",
        label="Pause",
        help="Pause the robot: what moves comes to its end, then it waits.",
        verb="pause",
    ),
    PageKey(
        page="where",
        name="step",
        key="greater_than_sign",
        action="verb('step')",
        label="Step",
        help="Let the paused robot go on to its next call of a child.",
        verb="step",
    ),
    PageKey(
        page="where",
        name="continue",
        key="B",
        action="verb('continue')",
        label="Continue",
        help="End the pause.",
        verb="continue",
    ),
    # -- readings over time
    PageKey(
        page="readings",
        name="back",
        key="escape",
        action="back",
        help="Back to the list; what is ticked is still watched.",
        label="Back",
    ),
    PageKey(
        page="readings",
        name="tick",
        key="enter",
        action="tick",
        help="Tick a reading: it is drawn over time, and remembered from now on; or end that.",
        label="Tick",
    ),
    PageKey(
        page="readings",
        name="freeze",
        key="Z",
        action="freeze",
        help="Let the plots stand still, and go on; the readings are remembered meanwhile.",
        label="Freeze",
    ),
    PageKey(
        page="readings",
        name="earlier",
        key="left",
        action="scroll(-1)",
        help="Look back, and forward again.",
        label="Back in time",
        shown="← →",
    ),
    PageKey(
        page="readings",
        name="later",
        key="right",
        action="scroll(1)",
        help="Look back, and forward again.",
    ),
    PageKey(
        page="readings",
        name="longer",
        key="plus,equals_sign",
        action="zoom(1)",
        help="Show a longer time, or a shorter one.",
    ),
    PageKey(
        page="readings",
        name="shorter",
        key="minus",
        action="zoom(-1)",
        help="Show a longer time, or a shorter one.",
    ),
    PageKey(
        page="readings",
        name="against",
        key="E",
        action="against",
        help="Draw the reading against the one that was ticked before it, and over time again.",
        label="Against",
    ),
    PageKey(
        page="readings",
        name="alarm",
        needs="alarm above",
        key="j",
        action="alarm",
        help="Set a threshold, at which an alarm is raised.",
        label="Threshold",
    ),
    PageKey(
        page="readings",
        name="acknowledge",
        needs="alarm ack",
        key="k",
        action="acknowledge",
        help="Acknowledge the alarm of the reading; where it has none, all alarms.",
        label="Acknowledge",
    ),
    # -- the messages on a wire
    PageKey(
        page="messages",
        name="back",
        key="escape",
        action="back",
        label="Back",
        help="Back to the list; the wire is watched no longer, unless a field is ticked.",
    ),
    PageKey(
        page="messages",
        name="plots",
        key="U",
        action="plots",
        label="Plots",
        help="Show what is ticked over time.",
        verb="readings",
    ),
    # -- questions and texts over a page
    PageKey(
        page="question",
        name="cancel",
        key="escape",
        action="answer(False)",
        label="Cancel",
        help="Do nothing, and go back.",
    ),
    PageKey(
        page="question",
        name="other",
        key="left,right",
        action="other",
        label="Choose",
        shown="← →",
        help="Go to the other button or list.",
    ),
    PageKey(
        page="text",
        name="search",
        key="slash",
        action="search",
        label="Search",
        help="Show only the lines that contain the letters which you type; esc shows all again.",
        verb="filter",
    ),
    PageKey(
        page="text",
        name="close",
        key="escape,q,enter",
        action="leave",
        label="Close",
        shown="esc",
        help="Close the text.",
        verb="quit",
    ),
)


def page_keys(page: str) -> tuple[PageKey, ...]:
    """Return the keys of a page, in the order of the registry."""
    return tuple(key for key in PAGE_KEYS if key.page == page)


KEYS_BY_ID: Mapping[str, PageKey] = {key.id: key for key in PAGE_KEYS}
