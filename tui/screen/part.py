"""The base of every page and widget: a part of the operator's app, whose errors do not end the program."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.error_boundary import ErrorBoundary

if TYPE_CHECKING:
    from textual import getters

    from robotree.tui.screen.operator_app import OperatorApp


class Part(ErrorBoundary):
    """Mixed into screens and widgets, before their Textual class; says which app they are in."""

    if TYPE_CHECKING:
        app = getters.app(OperatorApp)
