"""The words of the screen in the language of its reader: those that one sees most, in one place.

The English words stand where they are used, and are looked up here: `say("Delete")`. Each other language is
a file beside this one, with a line for each of `TEXTS` and of the registry's labels and states; a test
compares. Names of robots, verbs and keys are never translated: they are typed.

Arabic is written from right to left. Most terminals put letters where a program says and neither turn nor
join them; so both are done here, and a terminal that would do it again is told not to (decision 0131).
"""

from __future__ import annotations

import os
import tomllib
from functools import cache
from importlib.resources import files

from robotree.tui.errors import NoSuchLanguage

LANGUAGES = {"en": "English", "de": "Deutsch", "ar": "العربية"}
"""By code (ISO 639-1): the language in its own words."""
LEFTWARDS = frozenset({"ar"})
"""Languages that are written from right to left."""
VARIABLE = "ROBOTREE_LANGUAGE"

EXPLICIT, IMPLICIT = "\x1b[8l", "\x1b[8h"
"""What has a terminal leave the order of letters to the program, or see to it (ECMA-48, BDSM)."""

TEXTS = (
    *("ROBOT", "KIND", "STATE", "HEARD", "BY", "HOST", "EPOCH", "LEASE", "PROCESS", "ABOUT"),
    *("robots", "plan", "views", "log", "realm {name}", "read-only", "STOP", "0 robots"),
    *("view", "views", "host", "hosts", "lookup", "lookups"),
    *("under {name}", "PROTECTIVE STOP", "{key} resumes"),
    *("Leave", "Leave?", "delete {count} marked robots?", "Resume"),
    *("No robot is here yet.", "A new robot appears here by itself."),
    *("starts a simulated arm and rover", "starts a lookup service", "brings your own arm in"),
    "STALE: no lookup service is left; the lists may be old, known robots still obey",
)
"""Words of the screen that are neither a label of the registry nor a state."""

_chosen = ["en"]


def choose(code: str) -> None:
    """Have words in a language from now on.

    Args:
        code: of `LANGUAGES`.

    Raises:
        NoSuchLanguage: there is none of this code.
    """
    if code not in LANGUAGES:
        raise NoSuchLanguage(code, tuple(LANGUAGES))
    if code != "en":
        lexicon(code)
    if code in LEFTWARDS:
        _turned("")  # what it needs is missed now, not in the middle of a drawing
    _chosen[0] = code


def chosen() -> str:
    """Return the code of the language."""
    return _chosen[0]


def wanted() -> str:
    """Return the language that the user has chosen once and for all, `$ROBOTREE_LANGUAGE`; empty: none."""
    return os.environ.get(VARIABLE, "")


@cache
def lexicon(code: str) -> dict[str, str]:
    """Return the words of a language, by the English ones."""
    found: dict[str, str] = tomllib.loads(
        files("robotree.tui.words").joinpath(f"{code}.toml").read_text("utf-8")
    )
    return found


def say(text: str, **values: object) -> str:
    """Return words as they are drawn: in the chosen language, the letters from left to right.

    Args:
        text: in English; unknown words stay as they are.
        **values: for what stands in braces.
    """
    code = _chosen[0]
    found = text if code == "en" else lexicon(code).get(text, text)
    filled = found.format(**values) if values else found
    return _turned(filled) if code in LEFTWARDS and text in lexicon(code) else filled


def say_state(text: str) -> str:
    """Return a robot's state as it is drawn; one that names something of the robot stays as it is."""
    if _chosen[0] == "en":
        return text
    head, _, name = text.partition(" ")
    return say("under {name}", name=name) if head == "under" and name else say(text)


@cache
def _turned(text: str) -> str:
    """Return letters in the order in which they are drawn, joined as they are written."""
    import arabic_reshaper  # type: ignore[import-untyped] # pyright: ignore[reportMissingTypeStubs]
    from bidi import get_display  # type: ignore[import-untyped] # pyright: ignore[reportMissingTypeStubs]

    return str(get_display(arabic_reshaper.reshape(text), base_dir="R"))
