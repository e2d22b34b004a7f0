"""The bases of pages and widgets: parts of the operator's app.

Their errors do not end the program, and their keys come from the registry.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from textual import actions
from textual.await_complete import AwaitComplete
from textual.binding import Binding, BindingType
from textual.screen import Screen, ScreenResultType

from robotree.tui.line.page_keys import KEYS_BY_ID, page_keys
from robotree.tui.line.surface import Surface
from robotree.tui.screen.error_boundary import ErrorBoundary

if TYPE_CHECKING:
    from textual import getters

    from robotree.tui.screen.operator_app import OperatorApp


def bindings(page: str) -> list[BindingType]:
    """Return the bindings of a page beside the main one."""
    return [
        Binding(
            key.key,
            key.action,
            key.label,
            show=bool(key.label),
            key_display=key.shown or None,
            tooltip=key.help,
            id=key.id,
        )
        for key in page_keys(page)
    ]


_known: dict[type, Mapping[tuple[str, tuple[object, ...]], str]] = {}
"""By page or widget: the verb that each of its keys wants, by its action."""


def _wants(holder: type) -> Mapping[tuple[str, tuple[object, ...]], str]:
    if holder in _known:
        return _known[holder]
    found: dict[tuple[str, tuple[object, ...]], str] = {}
    for binding in getattr(holder, "BINDINGS", ()):
        if isinstance(binding, Binding) and binding.id and binding.id in KEYS_BY_ID:
            _, name, parameters = actions.parse(binding.action)
            found[name, parameters] = KEYS_BY_ID[binding.id].wants
    _known[holder] = found
    return found


def named_keys(holder: object) -> Mapping[str, str]:
    """Return the verb that each key of a page or widget wants, by the key's name in a keymap file."""
    own = (binding.id or "" for binding in getattr(holder, "BINDINGS", ()) if isinstance(binding, Binding))
    return {name: KEYS_BY_ID[name].wants for name in own if name in KEYS_BY_ID}


def refusal(holder: object, surface: Surface, action: str, parameters: tuple[object, ...]) -> str:
    """Return why a key of a page or widget is absent; empty: it is there."""
    verb = _wants(type(holder)).get((action, parameters), "")
    return surface.refusal(verb) if verb else ""


class Part(ErrorBoundary):
    """Mixed into screens and widgets, before their Textual class; says which app they are in."""

    KEYS_OF: ClassVar[str] = ""
    """The name of its keys in `line.page_keys`, which are bound; empty: it has none there."""

    if TYPE_CHECKING:
        app = getters.app(OperatorApp)
        BINDINGS: ClassVar[list[BindingType]]

    def __init_subclass__(cls, **named: Any) -> None:
        """Bind the keys before Textual gathers them."""
        if "KEYS_OF" in cls.__dict__:
            cls.BINDINGS = bindings(cls.KEYS_OF)  # pyright: ignore[reportConstantRedefinition] # Textual names it so
        super().__init_subclass__(**named)


class Leaving(Screen[ScreenResultType]):
    """A screen that goes only when it is in front. Styles follow the first screen class: name this one last.

    Textual's `dismiss` takes away whatever is on top. A page on its way out, because its work is done, or the
    second of two hasty keys, must not take away the page beneath.
    """

    def dismiss(self, result: ScreenResultType | None = None) -> AwaitComplete:
        """Leave, if still in front. See `Screen.dismiss`."""
        return super().dismiss(result) if self.is_current else AwaitComplete()
