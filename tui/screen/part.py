"""The bases of pages and widgets: a part of the operator's app, whose errors do not end the program."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from textual.await_complete import AwaitComplete
from textual.binding import BindingType
from textual.screen import Screen, ScreenResultType

from robotree.tui.screen.bindings import bindings
from robotree.tui.screen.error_boundary import ErrorBoundary

if TYPE_CHECKING:
    from textual import getters

    from robotree.tui.screen.operator_app import OperatorApp


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
