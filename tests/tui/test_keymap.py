"""Keys: a keymap file changes them as a whole or not at all, and none is lost in a paste."""

from __future__ import annotations

import itertools
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual._xterm_parser import XTermParser
from textual.events import Key, Paste
from textual.message import Message

from robotree.tui import exit_codes
from robotree.tui.cli import main
from robotree.tui.errors import BadKeymap
from robotree.tui.screen.driver import BEGIN, END, LONGEST, BoundedPaste, forgiving_decoder
from robotree.tui.screen.keymap import PRESETS, Keymap, default_keys, load, read


def test_without_a_file_the_keys_are_those_of_the_registry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.delenv("ROBOTREE_KEYS", raising=False)
    assert load() == Keymap()
    assert load().keys("delete") == ("d",)
    assert load().keys("stop") == ("space",)
    assert load().keys("nobody") == ()


def test_a_file_changes_some_keys_and_the_preset_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.delenv("ROBOTREE_KEYS", raising=False)
    file = tmp_path / "robotree" / "keys.toml"
    file.parent.mkdir()
    file.write_text('preset = "k9s"\n[keys]\nenslave = "E, f5"\npanel.run = "ctrl+e"\n"teleop.open" = "["\n')
    keys = load()
    assert keys.keys("show") == ("d", "y")
    assert keys.keys("delete") == ("ctrl+d",)
    assert keys.keys("enslave") == ("E", "f5")
    assert keys.keys("panel.run") == ("ctrl+e",)
    assert keys.keys("teleop.open") == ("left_square_bracket",)
    assert keys.keys("create") == ("n",)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_preset_can_be_used_as_it_is(preset: str) -> None:
    assert read(f'preset = "{preset}"', "keys.toml").changed == PRESETS[preset]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[keys", "it is no TOML"),
        ("colour = 1", "'colour' means nothing here"),
        ('preset = "vim"', "there is no preset 'vim'; there are robotree, k9s"),
        ("keys = 3", "keys must be a table"),
        ('[keys]\ndelet = "x"', "nothing is named 'delet'; did you mean delete"),
        ('[keys]\nzzzz = "x"', "nothing is named 'zzzz'; `?` on the screen shows what there is"),
        ("[keys]\ndelete = 4", "delete must be a text with one or more keys"),
        ('[keys]\ndelete = ""', "delete must be a text with one or more keys"),
        ('[keys]\ndelete = "strg+d"', "delete: 'strg+d' is no key; write for example y"),
        ('[keys]\nstop = "x"', "the protective stop keeps its keys, space and ctrl+s"),
        ('[keys]\ndelete = "space"', "delete: space and ctrl+s are the protective stop's"),
        ('[keys]\ndelete = "n"', "n would be the key of create and of delete"),
        ('[keys]\npanel.run = "R"', "R would be the key of resume and of panel.run"),
    ],
)
def test_a_file_that_is_wrong_is_one_sentence(text: str, says: str) -> None:
    with pytest.raises(BadKeymap) as refused:
        read(text, "keys.toml")
    assert str(refused.value).startswith("keys.toml: ")
    assert says in str(refused.value)
    assert "\n" not in str(refused.value).removesuffix("\n")


def test_the_program_does_not_start_with_a_keymap_that_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "keys.toml"
    file.write_text('[keys]\nstop = "x"\n')
    monkeypatch.setenv("ROBOTREE_KEYS", str(file))
    for module in ("supervising", "demos"):
        monkeypatch.setattr(f"robotree.tui.{module}.no_screen", lambda: "")
    for words in ([], ["demo"]):
        assert main(words) == exit_codes.USAGE
        said = capsys.readouterr().err
        assert said == f"robotree: {file}: the protective stop keeps its keys, space and ctrl+s\n"
    file.unlink()
    assert main([]) == exit_codes.USAGE
    assert "there is no such file; $ROBOTREE_KEYS names it" in capsys.readouterr().err


@given(
    name=st.sampled_from(sorted(default_keys())),
    key=st.text(max_size=12) | st.sampled_from(["ctrl+x", "f12", "?", "ä", "space", " ", "ctrl+ ", "+"]),
)
def test_whatever_is_written_the_stop_keeps_its_keys(name: str, key: str) -> None:
    quoted = "".join(f"\\U{ord(letter):08X}" for letter in key if not 0xD800 <= ord(letter) < 0xE000)
    try:
        keymap = read(f'[keys]\n"{name}" = "{quoted}"', "keys.toml")
    except BadKeymap as error:
        assert str(error).startswith("keys.toml: ")  # noqa: PT017 # both ways out are right
        return
    assert keymap.keys("stop") == ("space",)
    taken = {one for other in default_keys() if other != "stop" for one in keymap.keys(other)}
    assert not taken & {"space", "ctrl+s"}


# -- a paste has a largest size, wherever its marks are cut; keys before and behind it are keys ----

PARTS = st.lists(
    st.sampled_from([BEGIN, END, "\x1b[", "\x1b[20", "a", "q\n", "\x1b[A", "ü", " "]), max_size=12
)


def read_in_pieces(parser: XTermParser, text: str, cuts: list[int]) -> list[str]:
    found: list[Message] = []
    edges = [0, *sorted({min(cut, len(text)) for cut in cuts}), len(text)]
    for begin, end in itertools.pairwise(edges):
        if begin < end:
            found += parser.feed(text[begin:end])
    return [f"{one.key}" if isinstance(one, Key) else f"<{one.text}>" for one in found
            if isinstance(one, Key | Paste)]  # fmt: skip


@given(PARTS, st.lists(st.integers(0, 60), max_size=6))
def test_what_is_not_too_long_is_read_as_before_however_it_is_cut(parts: list[str], cuts: list[int]) -> None:
    text = f"x{''.join(parts)}{END}y"
    assert read_in_pieces(BoundedPaste(), text, cuts) == read_in_pieces(XTermParser(), text, cuts)


def test_the_stop_ends_a_paste_without_an_end_and_no_byte_is_an_error() -> None:
    parser, decode = BoundedPaste(), forgiving_decoder("utf-8")().decode
    read: list[Message] = []
    for piece in (b"\xe9", b"\x13", BEGIN.encode(), b"abc", b"\x13", b"q"):
        if text := decode(piece):
            read += parser.feed(text)
    assert [one.key for one in read if isinstance(one, Key)][-3:] == ["ctrl+s", "ctrl+s", "q"]


def test_a_paste_without_an_end_fills_no_memory_and_the_keys_behind_it_are_keys() -> None:
    parser, piece = BoundedPaste(), "spam and eggs " * 1000
    list(parser.feed(BEGIN))
    tracemalloc.start()
    for _ in range(300):  # 4 million characters
        assert not list(parser.feed(piece))
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 12 * LONGEST, held
    (paste, key) = [one for one in parser.feed(f"{END}q") if isinstance(one, Key | Paste)]
    assert isinstance(paste, Paste)
    assert len(paste.text) == LONGEST
    assert isinstance(key, Key)
    assert key.key == "q"
