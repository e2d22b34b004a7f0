"""Creating a virtual robot: choose its file, choose its class, name it, choose its host."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import Button, DirectoryTree, Input, Label, Static
from textual.widgets.directory_tree import DirEntry
from textual.widgets.tree import TreeNode

from robotree.files import text as text_of
from robotree.tui.line import sources
from robotree.tui.line.grammar import Line, Value
from robotree.tui.screen.key_guard import Form
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.part import Part
from robotree.tui.screen.source_outline import ClassOutline, outline, suggested_name
from robotree.tui.screen.widgets.field_row import Choice, FieldRow, filled_in
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen import wording
from robotree.vr.base.address import check_name
from robotree.vr.base.description import CommandSpec
from robotree.vr.base.errors import BadName
from robotree.vr.bundle import LARGEST
from robotree.vr.bundle.manifest import PROGRAM

ANY_HOST, OWN_HOST = "*", "+"
"""Choices that are no host's name: any host, and a host for this robot alone."""


class SourceTree(Part, DirectoryTree):
    """Folders and Python files, without what is no robot: a panel comes with the page beside it."""

    ICON_NODE = "▸ "
    ICON_NODE_EXPANDED = "▾ "
    ICON_FILE = "  "

    def filter_paths(self, paths: Iterable[Path]) -> Iterable[Path]:
        """Leave out hidden things, caches and whatever is no source."""
        return [
            path
            for path in paths
            if not path.name.startswith((".", "__"))
            and ((path.suffix == ".py" and not path.name.endswith(PROGRAM)) or _is_folder(path))
        ]

    def _populate_node(self, node: TreeNode[DirEntry], content: Iterable[Path]) -> None:
        """Begin at the first file whenever the folder has been read.

        A tree also reads its folder by itself, when it is shown first or has another path; Textual
        (8.2.8) sends no message when that is done, and has no public method for it.
        """
        super()._populate_node(node, content)
        if node is self.root:
            self.call_after_refresh(self._to_first_file)  # a line has its place only then

    def _to_first_file(self) -> None:
        """Put the cursor on the first file."""
        found = [node for node in self.root.children if not node.allow_expand]
        if found and self.last_line >= 0:  # gives each node its line
            self.move_cursor(found[0])


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:
        return False


def places() -> list[tuple[str, Path]]:
    """Return where one may want to begin: here, in the examples, and where packages have pages."""
    from importlib.resources import files

    offers = {one.file.parent: one.package for one in sources.offered() if one.file is not None}
    found = [("this folder", Path.cwd()), *((package, folder) for folder, package in offers.items())]
    try:
        examples = Path(str(files("robotree.examples").joinpath("")))
    except (ModuleNotFoundError, ValueError):
        return found
    return [("examples", examples), *found] if examples.is_dir() else found


class NewPage(Form, Page):
    """The file picker, and what is in the file."""

    PAGE = "new virtual robot"
    KEYS_OF = "new"

    def __init__(self) -> None:
        """Nothing is chosen yet."""
        super().__init__()
        self.path: Path | None = None
        self._found: list[ClassOutline] = []
        self._suggested = ""
        """The name that was offered last; any other name was typed by a person."""
        self._places = places()
        self._described: ClassOutline | None = None
        """The class that the page shows."""
        self._outlined: ClassOutline | None = None
        """The class whose settings are shown."""
        self._rows: list[FieldRow] = []

    def parts(self) -> ComposeResult:
        """Tree on the left, form on the right."""
        with Horizontal(classes="columns"):
            with VerticalScroll(classes="picker", can_focus=False):
                places = [(f"{word}  {_short(path)}", str(path)) for word, path in self._places]
                yield Choice(places, chosen=places[0][1], id="place")
                yield SourceTree(self._places[0][1], id="sources")
            with VerticalScroll(classes="source", can_focus=False):
                yield Static("Choose a Python file.", id="source-about", markup=False)
                yield Label("class", classes="caption", markup=False)
                yield Choice([], prompt="choose a file first", id="class")
                yield Label("name", classes="caption", markup=False)
                yield Input(placeholder="letters, digits, - and _", compact=True, id="name", max_length=64)
                yield Label("host", classes="caption", markup=False)
                yield Choice(self._hosts(), chosen=ANY_HOST, id="host")
                yield Label("settings", classes="caption", id="settings-caption", markup=False)
                yield Vertical(id="settings")
                yield Label("", id="new-complaint", classes="field-complaint", markup=False)
                yield Button("Create", id="create", variant="primary", disabled=True, compact=True)

    def _hosts(self) -> list[tuple[str, str]]:
        hosts = ((name, name) for name in self.app.store.hosts)
        return [("any", ANY_HOST), *hosts, ("a process of its own", OWN_HOST)]

    def on_mount(self) -> None:
        """Begin in the tree, at its first file."""
        self.query_one("#settings-caption").display = False
        tree = self.query_one(SourceTree)
        tree.show_root = False
        tree.focus()

    @on(Choice.Changed, "#place")
    def _elsewhere(self) -> None:
        if place := self.query_one("#place", Choice).chosen:
            self.query_one(SourceTree).path = place

    @on(DirectoryTree.FileSelected)
    def _choose(self, event: DirectoryTree.FileSelected) -> None:
        if not self.carrying:
            self.read(event.path)

    def read(self, path: Path) -> None:
        """Read a file; until then there is nothing that could be created."""
        self.path, self._found = path, []
        self._judge()
        self._look_into(path)

    @work(exclusive=True, thread=True, exit_on_error=False)
    def _look_into(self, path: Path) -> None:
        """Look into a file without running it."""
        found: list[ClassOutline] = []
        try:
            found = outline(text_of(path, LARGEST))
            trouble = "" if found else "It defines no virtual robot: no class derives from VirtualRobot."
        except SyntaxError as error:
            trouble = f"It is no Python that can be read: line {error.lineno}: {error.msg}"
        except OSError as error:
            trouble = f"It cannot be read: {error.strerror}"
        except ValueError as error:
            trouble = f"It cannot be read: {error}"
        self.app.call_from_thread(self._offer, path, found, trouble)

    def _offer(self, path: Path, found: list[ClassOutline], trouble: str) -> None:
        if path != self.path or self.carrying or not self.is_attached:
            return  # another file was chosen meanwhile, or the page was left
        self._found = found
        chooser = self.query_one("#class", Choice)
        chooser.offer((one.name, one.name) for one in found)
        if found:
            chooser.value = found[-1].name
        self._describe(trouble)

    @on(Choice.Changed, "#class")
    def _class_changed(self) -> None:
        if self._chosen != self._described:
            self._describe("")

    @property
    def _chosen(self) -> ClassOutline | None:
        name = self.query_one("#class", Choice).chosen
        return next((one for one in self._found if one.name == name), None)

    def _describe(self, trouble: str) -> None:
        chosen = self._described = self._chosen
        muted = tint(self.app, "muted")
        text = Text.assemble((self.path.name if self.path else "", "bold"))
        if trouble:
            text.append(f"\n{trouble}", tint(self.app, "warning"))
        if chosen:
            text.append(f"\n{wording.summary(chosen.doc)}")
            for name, kind in chosen.slots:
                text.append(f"\nslot {name}: {kind}", muted)
            text.append(f"\ncommands {', '.join(chosen.commands) or 'none'}", muted)
            line = self.query_one("#name", Input)
            if line.value in ("", self._suggested):
                taken = frozenset(self.app.store.descriptions) | frozenset(self.app.store.robots)
                line.value = self._suggested = suggested_name(chosen.name, taken)
            line.focus()
        self.query_one("#source-about", Static).update(text)
        self._offer_settings(chosen)
        self._judge()

    def _offer_settings(self, chosen: ClassOutline | None) -> None:
        """Show a field for each setting of the chosen class, with its default."""
        if chosen == self._outlined:
            return
        self._outlined = chosen
        self._rows = [FieldRow(setting, {}) for setting in chosen.settings] if chosen else []
        self.query_one("#settings-caption").display = bool(self._rows)
        place = self.query_one("#settings", Vertical)
        place.remove_children()
        place.mount(*self._rows)

    @on(FieldRow.Onward)
    def _onward(self, event: FieldRow.Onward) -> None:
        """Go on to the next setting, and from the last one to the button."""
        following = self._rows[self._rows.index(event.row) + 1 :]
        if following:
            following[0].focus_entry()
        else:
            self.query_one("#create", Button).focus()

    def _edited(self) -> tuple[str, ...] | None:
        """Return the settings that were edited, as `NAME=VALUE`; None: one is wrong, and says so."""
        spec = CommandSpec(name="create", parameters=tuple(row.spec for row in self._rows))
        arguments = filled_in(spec, self._rows)
        if arguments is None:
            return None
        touched = {row.spec.name for row in self._rows if row.touched}
        return tuple(f"{name}={wording.typed(arguments[name])}" for name in arguments if name in touched)

    @on(Input.Changed, "#name")
    def _named(self) -> None:
        if not self.carrying:
            self._judge()

    def _judge(self) -> bool:
        """Say what is wrong with the name; return whether the robot can be created."""
        name, wrong = self.query_one("#name", Input).value, ""
        store = self.app.store
        if name:
            try:
                check_name(name)
            except BadName as error:
                wrong = str(error)
        if name in store.descriptions or name in store.robots:
            wrong = f"a robot named {name} is already running"
        complaint = self.query_one("#new-complaint", Label)
        complaint.update(wrong and f"✗ {wrong}")
        ready = bool(self._chosen and name and not wrong)
        self.query_one("#create", Button).disabled = not ready
        return ready

    @on(Input.Submitted, "#name")
    @on(Button.Pressed, "#create")
    def create(self) -> None:
        """Ask for the robot of the file; until the answer the page takes nothing."""
        if self.carrying:
            return
        chosen = self._chosen
        if not (self._judge() and chosen and self.path):
            return
        host = self.query_one("#host", Choice).chosen
        edited = self._edited()
        if edited is None:
            return
        name = self.query_one("#name", Input).value
        values: dict[str, Value] = {"FILE": f"{self.path}:{chosen.name}", "NAME": name}
        if edited:
            values["PARAMETER=VALUE"] = edited
        if host == OWN_HOST:
            values["--own-host"] = True
        elif host != ANY_HOST:
            values["HOST"] = host
        self.query_one("#create", Button).disabled = True
        self.carrying = f"{name} is being made"
        self.query_one("#new-complaint", Label).update(f"… {self.carrying}")
        self.set_focus(None)  # a field would take letters, and the space that stops
        making = self._ask_for(Line("create", values))  # the page may be left meanwhile
        self.app.run_worker(making, group="create", exit_on_error=False)

    def action_back(self) -> None:
        """Leave; say what goes on."""
        if self.carrying:
            self.app.tell(f"{self.carrying} all the same; the log will say what comes of it", "warning")
        self.dismiss()

    async def _ask_for(self, line: Line) -> None:
        """Create; go back to where the robot appears, or stay and say what was wrong."""
        refusal = await self.app.attempt(line)
        self.carrying = ""
        if not self.is_attached:
            return
        if not refusal:
            typed, in_front = self.app.guard.typing, self.is_current
            self.dismiss()
            if in_front:
                self.app.guard.opened_by_itself(self.app.screen, typed=typed)
            return
        self.query_one("#new-complaint", Label).update(f"✗ {refusal}")
        self.query_one("#create", Button).disabled = False
        self.query_one("#name", Input).focus()


def _short(path: Path) -> str:
    try:
        return f"~/{path.relative_to(Path.home())}"
    except ValueError:
        return str(path)
