"""How the screen looks: the colours and the language that a person has chosen."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

from textual.app import App
from textual.theme import Theme

from robotree.tui import words
from robotree.tui.errors import SupervisorError
from robotree.tui.line.installed import lacking
from robotree.tui.processes.choices import Choices
from robotree.tui.screen.palette import reduced_theme
from robotree.tui.screen.themes import OURS, REDUCED, SIXTEEN, chosen, folder
from robotree.tui.seen.store import Weight

VERBS = frozenset({"theme", "language"})
"""Verbs about how the screen looks."""


class Looks:
    """The part of an app that changes how it looks."""

    def __init__(self, app: App[int], tell: Callable[[str, Weight], None], *, keeps: bool) -> None:
        """Register our themes, and take the one that the environment wants.

        Args:
            app: that looks so.
            tell: enters a sentence in its log.
            keeps: whether what is chosen is kept for the next time.
        """
        self._app, self._tell, self._keeps = app, tell, keeps
        self.kept = Choices()
        """The theme and the language that were chosen last."""
        self.own_themes: tuple[Theme, ...] = ()
        self._ordered = False
        """Whether the terminal leaves the order of letters to us."""
        for theme in (*OURS, *REDUCED.values(), *SIXTEEN.values()):
            app.register_theme(theme)
        wanted = os.environ.get("TEXTUAL_THEME", "")
        ours = chosen(wanted, app.console.color_system).name
        app.theme = wanted if wanted in app.available_themes and wanted not in REDUCED else ours

    def wear(self, kept: Choices, themes: Sequence[Theme]) -> None:
        """Look as the operator has chosen last, or once and for all.

        Args:
            kept: what was chosen; what will be is kept there.
            themes: of the operator's own.

        Raises:
            NoSuchLanguage: `$ROBOTREE_LANGUAGE` names none.
        """
        self.kept, self.own_themes = kept, tuple(themes)
        if not self._keeps:
            kept.keep_nothing()
        for theme in themes:
            self._app.register_theme(theme)
            self._app.register_theme(reduced_theme(theme))
        language = kept.get("language", "")
        words.choose(words.wanted() or (language if language in words.LANGUAGES else "en"))
        wanted = os.environ.get("TEXTUAL_THEME", "") or kept.get("theme", "")
        if wanted.removeprefix("robotree-") in self._theme_names:
            self._take(wanted)

    @property
    def _theme_names(self) -> list[str]:
        return [theme.name.removeprefix("robotree-") for theme in (*OURS, *self.own_themes)]

    def _take(self, theme: str) -> None:
        self._app.theme = chosen(theme, self._app.console.color_system, self.own_themes).name

    def change(self, what: str, name: str = "") -> None:
        """Show other colours, or other words: `theme` and `language`; without a name, the next ones."""
        if what == "language":
            self._speak(name or _behind(words.chosen(), list(words.LANGUAGES)))
            return
        known = self._theme_names
        now = self._app.theme.removeprefix("robotree-").removesuffix("-256").removesuffix("-16")
        name = name.removeprefix("robotree-") or _behind(now, known)
        if name in known:
            self._take(name)
        elif name in self._app.available_themes:
            self._app.theme = name
        else:
            own = f"one of yours is a file {folder()}/NAME.toml, read at the start"
            self._tell(f"there is no theme {name!r}; there are {', '.join(known)}; {own}", "error")
            return
        self.kept.choose("theme", name)
        self._tell(f"theme {name}", "good")

    def _speak(self, code: str) -> None:
        try:
            words.choose(code)
        except (SupervisorError, ImportError) as error:
            lack = lacking("language", error) if isinstance(error, ImportError) else error
            self._tell(str(lack or error), "error")
            return
        self.kept.choose("language", code)
        self.order_letters()
        for screen in self._app.screen_stack:
            for line in screen.query("KeyLine"):
                line.refresh(recompose=True)
        self._tell(f"language {code}", "good")

    def order_letters(self, *, ends: bool = False) -> None:
        """Tell the terminal who sees to the order of letters: we, as long as words go from right to left."""
        driver = self._app._driver  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] # Textual's way to the terminal
        if driver is not None and (words.chosen() in words.LEFTWARDS or self._ordered):
            self._ordered = words.chosen() in words.LEFTWARDS and not ends
            driver.write(words.EXPLICIT if self._ordered else words.IMPLICIT)


def _behind(now: str, known: Sequence[str]) -> str:
    """Return what comes behind one of several; the first, where it is none of them or the last."""
    return known[(known.index(now) + 1) % len(known)] if now in known else known[0]
