"""All keys and verbs: from the registry, and from what the pages bind."""

from __future__ import annotations

from collections.abc import Iterable

from rich.text import Text
from textual.binding import Binding

from robotree.tui.line.action import Action, Scope, spell
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.line.page_keys import PAGES, page_keys
from robotree.tui.screen.keymap import Keymap
from robotree.tui.screen.operator_app import OperatorApp
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.widgets.marks import STATUSES, tint

ROOM = 11
"""Columns that the keys of a line take."""


def help_text(app: OperatorApp) -> Text:
    """Return the help page."""
    strong, muted = tint(app, "primary", bold=True), tint(app, "muted")
    text = Text()

    def block(title: str, rows: Iterable[tuple[str, str]]) -> None:
        text.append(f"{title}\n", strong)
        for keys, meaning in rows:
            text.append(f"  {keys:<{ROOM}}", strong)
            text.append(f"{meaning}\n")
        text.append("\n")

    if app.OWN_KEYS:
        block("In a recording", app.OWN_KEYS)
    else:
        _stop(app, text)
    pages = {one.name: (one.title, page_rows(one.name, app.keymap)) for one in PAGES if one.title}
    front = getattr(app.screen, "KEYS_OF", "")
    if front in pages:  # what works here and now comes first
        block(*pages.pop(front))
    block("On every page, but not in a field that you type in", _actions(app, Scope.PROGRAM))
    block("On the main page", [*_actions(app, Scope.PAGE), *_own(MainPage)])
    for title, rows in pages.values():
        block(title, rows)
    text.append("Verbs", strong)
    text.append("  at the `:` prompt, on the command line after `robotree`, and in session scripts\n", muted)
    for actions in app.prompt.groups.values():
        for action in actions:
            text.append(f"  {action.usage}\n", "bold")
            text.append(f"      {action.help}\n", muted)
    text.append("\nSigns\n", strong)
    text.append(f"  {'   '.join(f'{sign} {status}' for status, (sign, _) in STATUSES.items())}\n")
    return text


def page_rows(page: str, keymap: Keymap) -> list[tuple[str, str]]:
    """Return the keys of a page with what they do; those that do the same share a line."""
    found: dict[str, list[str]] = {}
    for key in page_keys(page):
        found.setdefault(key.help, []).append(
            key.shown
            if key.shown and key.id not in keymap.changed
            else " ".join(map(spell, keymap.keys(key.id)))
        )
    return [(" ".join(keys), meaning) for meaning, keys in found.items()]


def _own(page: type[Page]) -> list[tuple[str, str]]:
    """Return what the main page binds beside the registry."""
    helps = {action.help for action in ACTIONS}
    bound = [binding for binding in page.BINDINGS if isinstance(binding, Binding)]
    return [(spell(one.key), one.tooltip) for one in bound if one.tooltip not in helps]


def _stop(app: OperatorApp, text: Text) -> None:
    strong, stop = tint(app, "primary", bold=True), BY_VERB["stop"]
    text.append("Protective stop\n", tint(app, "error", bold=True))
    text.append(f"  {spell(stop.key):<{ROOM}}", strong)
    text.append("stops every robot at once, on every page. In a field that you type in it is a space:\n")
    text.append(f"  {spell(stop.typing_key):<{ROOM}}", strong)
    resume = f"{app.keymap.spelled('resume')} resumes; " if app.keyboard.has(BY_VERB["resume"]) else ""
    text.append(f"stops every robot even then. {resume}nothing moves by itself.\n\n")


def _actions(app: OperatorApp, scope: Scope) -> Iterable[tuple[str, str]]:
    """Return keys and meanings of the actions of a scope, without the stop, which is shown before."""
    for action in app.keyboard.actions:
        if action.key and action.scope is scope and action.verb != "stop":
            keys = [*app.keymap.keys(action.verb), *filter(None, [action.typing_key])]
            yield " ".join(map(spell, keys)), _meaning(app, action)
    if scope is Scope.PROGRAM:
        yield spell(app.COMMAND_PALETTE_BINDING), "Palette: everything by name, colours, a screenshot."


def _meaning(app: OperatorApp, action: Action) -> str:
    return f"Leave. {app.farewell}" if action.verb == "quit" and app.farewell else action.help
