"""The keys of the pages beside the main one: the other half of the registry (`actions`). Pure.

Pages make their bindings from it, the help page its rows, a keymap file finds the names here. A letter has
one meaning in the whole program: on a page it is either the verb of that letter, or belongs to this page
alone (a test compares).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

ENTER = "Into the form, and on to the next field. It never runs anything."
AT_REST = "at the list of commands"
"""Where the letters of a panel are keys: nobody types there."""

_CURSOR = "Move the cursor, with shift by five cells; the robot says which way it would take."


@dataclass(frozen=True, slots=True)
class PageKey:
    """One key of one page."""

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
    page: str = ""
    """The name of its page."""

    @property
    def id(self) -> str:
        """Its name in a keymap file."""
        return f"{self.page}.{self.name}"

    @property
    def wants(self) -> str:
        """The verb without which it is absent (`Surface.withholds`); empty: it is never."""
        return self.needs or self.verb


class KeyedPage(NamedTuple):
    """A page with keys of its own."""

    name: str
    """Its `KEYS_OF`."""
    title: str
    """Over its keys in the help of the full screen; empty: that does not show them."""
    keys: tuple[PageKey, ...]


def _page(name: str, title: str, *keys: PageKey) -> KeyedPage:
    return KeyedPage(name, title, keys)


def _jog(name: str, key: str, axis: str, direction: int, sentence: str) -> PageKey:
    return PageKey(name, key, f"jog('{axis}', {direction})", sentence, needs="call")


PAGES: tuple[KeyedPage, ...] = (
    _page(
        "panel",
        "In the panel of a robot",
        PageKey(
            "back", "escape", "back", "Leave the panel; what runs goes on.", label="Back", while_busy=True
        ),
        PageKey("form", "enter", "fill_in", ENTER),
        PageKey("run", "ctrl+r", "run", "Run the command as it is filled in.", needs="call", label="Run"),
        PageKey("list", "ctrl+l", "list", "Go to the list of commands."),
        PageKey(
            "now",
            "ctrl+n",
            "follow",
            "Let the field follow the robot again, after something was typed into it.",
        ),
        PageKey(
            "copy",
            "ctrl+y",
            "copy",
            "Copy the command line that does the same as the form.",
            label="Copy line",
            while_busy=True,
        ),
        PageKey(
            "teleoperate", "x", "teleoperate", f"Tele-operate, {AT_REST}.", needs="call", label="Tele-operate"
        ),
        PageKey(
            "cancel",
            "c",
            "cancel",
            f"Cancel all that the robot does, {AT_REST} or while the form in front runs.",
            label="Cancel",
            verb="cancel",
            while_busy=True,
        ),
        PageKey(
            "halt",
            "exclamation_mark",
            "halt",
            f"Stop this robot alone, or the members of this group, {AT_REST} or while the form runs.",
            shown="!",
            verb="stop",
            while_busy=True,
        ),
        PageKey("about", "i", "about", f"Describe the robot in full, {AT_REST}.", verb="show"),
    ),
    _page(
        "teleop",
        "In the tele-operation of an arm",
        _jog("forward", "up", "x", 1, "Move forward, back."),
        _jog("back", "down", "x", -1, "Move forward, back."),
        _jog("left", "left", "y", 1, "Move left, right."),
        _jog("right", "right", "y", -1, "Move left, right."),
        _jog("up", "pageup", "z", 1, "Move up, down."),
        _jog("down", "pagedown", "z", -1, "Move up, down."),
        _jog("twist-left", "comma", "twist", 1, "Twist the gripper."),
        _jog("twist-right", "full_stop", "twist", -1, "Twist the gripper."),
        PageKey("larger", "plus,equals_sign", "resize(1)", "Larger steps.", label="Step", shown="+"),
        PageKey("smaller", "minus", "resize(-1)", "Smaller steps.", label="Step", shown="-"),
        PageKey("open", "o", "grip('open')", "Open the gripper.", needs="call", label="Open"),
        PageKey("close", "O", "grip('close')", "Close the gripper.", needs="call", label="Close"),
        PageKey(
            "cancel",
            "c",
            "cancel",
            "Cancel all that the robot does; it holds where it is.",
            label="Cancel",
            verb="cancel",
        ),
        PageKey(
            "camera",
            "v",
            "camera",
            "Look at the next picture of the workspaces.",
            label="Camera",
            verb="views",
        ),
        PageKey("next", "V", "camera", "Look at the next picture of the workspaces.", verb="camera"),
        PageKey("leave", "escape", "dismiss", "Back to the panel.", label="Back"),
    ),
    _page(
        "new",
        "On the page for new robots",
        PageKey(
            "leave",
            "escape",
            "back",
            "Leave the page; a robot that is just being made is made nevertheless.",
            label="Back",
            while_busy=True,
        ),
    ),
    _page(
        "plan",
        "On the plan of a place, and in a picture",
        PageKey(
            "up",
            "up",
            "cursor(0, -1)",
            "Move the cursor, with shift by five cells; the robot says which way it would take.",
            shown="↑ ↓ ← →",
        ),
        *(
            PageKey(name, key, f"cursor({across}, {down})", _CURSOR, shown=" ")
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
            "go",
            "enter",
            "choose",
            "Ask before the selected robot goes to the point under the cursor; it says what it would do.",
            needs="go",
            label="Go there",
        ),
        PageKey("nearer", "plus,equals_sign", "zoom(1)", "See less, and larger.", shown="+"),
        PageKey("further", "minus", "zoom(-1)", "See more, and smaller."),
        PageKey("all", "0", "zoom(0)", "See everything that stands there."),
        PageKey(
            "next",
            "right_square_bracket",
            "robot(1)",
            "Select the next robot of this place, or the one before.",
            label="Robot",
            shown="[ ]",
        ),
        PageKey(
            "previous",
            "left_square_bracket",
            "robot(-1)",
            "Select the next robot of this place, or the one before.",
            shown=" ",
        ),
    ),
    _page(
        "compose",
        "In the composer",
        PageKey(
            "add",
            "a",
            "add",
            "Add a step below: a command of a robot, repeat, if, together, part, wait.",
            needs="compose",
            label="Add",
        ),
        PageKey("remove", "delete", "remove", "Take a step out, and what is in it.", needs="compose"),
        PageKey("up", "ctrl+up", "move(-1)", "Move a step up, down.", needs="compose"),
        PageKey("down", "ctrl+down", "move(1)", "Move a step up, down.", needs="compose"),
        PageKey("in", "right", "nest(1)", "Put a step into the one above, out of it.", needs="compose"),
        PageKey("out", "left", "nest(-1)", "Put a step into the one above, out of it.", needs="compose"),
        PageKey(
            "parametrise",
            "dollar_sign",
            "parametrise",
            "Make a value of the step a parameter.",
            needs="compose",
            label="Parameter",
            shown="$",
        ),
        PageKey(
            "show",
            "T",
            "show",
            "Lead a robot by hand: what it does becomes steps.",
            needs="compose",
            label="By hand",
        ),
        PageKey(
            "try",
            "f5",
            "try",
            "Carry it out in a twin of the cell, where nothing real moves.",
            needs="compose",
            label="Try",
        ),
        PageKey(
            "make",
            "ctrl+r",
            "make",
            "Write the page, its panel and its test into this folder.",
            needs="compose",
            label="Make it",
        ),
        PageKey("back", "escape", "back", "Leave the line that is edited, then the composer.", label="Back"),
    ),
    _page(
        "question",
        "In a question",
        PageKey("cancel", "escape", "answer(False)", "Do nothing, and go back.", label="Cancel"),
        PageKey(
            "other", "left,right", "other", "Go to the other button or list.", label="Choose", shown="← →"
        ),
    ),
    _page(
        "where",
        "Where a robot is",
        PageKey("back", "escape", "back", "Back to the list; the robot goes on as it does.", label="Back"),
        PageKey(
            "pause",
            "b",
            "verb('pause')",
            "Pause the robot: what moves comes to its end, then it waits.",
            label="Pause",
            verb="pause",
        ),
        PageKey(
            "step",
            "greater_than_sign",
            "verb('step')",
            "Let the paused robot go on to its next call of a child.",
            label="Step",
            verb="step",
        ),
        PageKey("continue", "B", "verb('continue')", "End the pause.", label="Continue", verb="continue"),
    ),
    _page(
        "messages",
        "On the page of the messages of a wire",
        PageKey(
            "back",
            "escape",
            "back",
            "Back to the list; the wire is watched no longer, unless a field is ticked.",
            label="Back",
        ),
        PageKey("plots", "U", "plots", "Show what is ticked over time.", label="Plots", verb="readings"),
    ),
    _page(
        "readings",
        "On the page of readings over time",
        PageKey("back", "escape", "back", "Back to the list; what is ticked is still watched.", label="Back"),
        PageKey(
            "tick",
            "enter",
            "tick",
            "Tick a reading: it is drawn over time, and remembered from now on; or end that.",
            label="Tick",
        ),
        PageKey(
            "freeze",
            "Z",
            "freeze",
            "Let the plots stand still, and go on; the readings are remembered meanwhile.",
            label="Freeze",
        ),
        PageKey(
            "earlier",
            "left",
            "scroll(-1)",
            "Look back, and forward again.",
            label="Back in time",
            shown="← →",
        ),
        PageKey("later", "right", "scroll(1)", "Look back, and forward again."),
        PageKey("longer", "plus,equals_sign", "zoom(1)", "Show a longer time, or a shorter one."),
        PageKey("shorter", "minus", "zoom(-1)", "Show a longer time, or a shorter one."),
        PageKey(
            "against",
            "E",
            "against",
            "Draw the reading against the one that was ticked before it, and over time again.",
            label="Against",
        ),
        PageKey(
            "alarm",
            "j",
            "alarm",
            "Set a threshold, at which an alarm is raised.",
            needs="alarm above",
            label="Threshold",
        ),
        PageKey(
            "acknowledge",
            "k",
            "acknowledge",
            "Acknowledge the alarm of the reading; where it has none, all alarms.",
            needs="alarm ack",
            label="Acknowledge",
        ),
    ),
    _page(
        "text",
        "In a text",
        PageKey(
            "search",
            "slash",
            "search",
            "Show only the lines that contain the letters which you type; esc shows all again.",
            label="Search",
            verb="filter",
        ),
        PageKey(
            "close", "escape,q,enter", "leave", "Close the text.", label="Close", shown="esc", verb="quit"
        ),
    ),
    _page(
        "attend",
        "While a command goes on only as long as a key is held",
        PageKey("end", "escape", "end", "End the command that goes on while a key is held.", label="End it"),
    ),
    _page(
        "user",
        "",
        PageKey("open", "enter", "open", "Open what is chosen.", label="Choose"),
        PageKey("leave", "q", "leave", "Leave; what goes on by itself goes on.", label="Quit", verb="quit"),
    ),
    _page(
        "doing",
        "",
        PageKey(
            "back", "escape", "back", "Back to the list; what runs goes on.", label="Back", while_busy=True
        ),
        PageKey("begin", "ctrl+r", "begin", "Begin, as it is filled in.", needs="call", label="Begin"),
    ),
    _page(
        "writing",
        "",
        PageKey("back", "escape", "back", "Back to the list; what was written is not kept.", label="Back"),
        PageKey("make", "ctrl+r", "make", "Check and make it.", needs="create", label="Make it"),
    ),
)
PAGE_KEYS = tuple(replace(key, page=page.name) for page in PAGES for key in page.keys)


def page_keys(page: str) -> tuple[PageKey, ...]:
    """Return the keys of a page, in their order."""
    return tuple(key for key in PAGE_KEYS if key.page == page)


KEYS_BY_ID: Mapping[str, PageKey] = {key.id: key for key in PAGE_KEYS}
