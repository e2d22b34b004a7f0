"""The words of the screen in each language: none is missing, none is too much, and they fit."""

from __future__ import annotations

import re

import pytest
from rich.cells import cell_len

from robotree.tui import words
from robotree.tui.errors import NoSuchLanguage
from robotree.tui.line.actions import ACTIONS
from robotree.tui.line.page_keys import PAGE_KEYS
from robotree.tui.seen.status import COUNTED, STATUSES

OTHERS = sorted(words.LANGUAGES.keys() - {"en"})
LABELS = {one.label for one in (*ACTIONS, *PAGE_KEYS) if one.label}
USED = {*words.TEXTS, *STATUSES, *COUNTED.values()} | LABELS


@pytest.mark.parametrize("code", OTHERS)
def test_each_text_is_there_in_each_language_and_no_other(code: str) -> None:
    found = words.lexicon(code)
    assert sorted(USED - found.keys()) == [], "missing"
    assert sorted(found.keys() - USED) == [], "of no use"
    for english, text in found.items():
        assert text.strip() == text
        assert text
        assert sorted(re.findall(r"\{\w+\}", text)) == sorted(re.findall(r"\{\w+\}", english)), english


@pytest.mark.parametrize("code", words.LANGUAGES)
def test_no_word_is_much_longer_than_its_place(code: str) -> None:
    words.choose(code)
    for text in USED & {*words.TEXTS, *STATUSES}:
        if "{" not in text and len(text) < 20:
            assert cell_len(words.say(text)) <= len(text) + 12, text
    labels = {one.label for one in (*ACTIONS, *PAGE_KEYS) if one.label}
    assert max(cell_len(words.say(label)) for label in labels) <= 14


def test_arabic_is_drawn_from_right_to_left_with_its_letters_joined_and_names_as_they_are() -> None:
    words.choose("ar")
    assert words.say("Delete") == "\ufed1\ufeac\ufea3", "feh, dhal, hah: alone, final, initial"
    assert words.say("under {name}", name="arm-1") == f"arm-1 {words.say('under {name}', name='')[-3:]}"
    assert words.say_state("under arm-1").startswith("arm-1 ")
    assert words.say("proxy arm-1 …") == "proxy arm-1 …", "what is no text of ours stays"


def test_a_language_that_there_is_not_is_refused_with_those_that_there_are() -> None:
    with pytest.raises(NoSuchLanguage, match="no language 'xx'; there are en, de, ar"):
        words.choose("xx")
    assert words.chosen() == "en"
