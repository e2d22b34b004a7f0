"""Who is let in at the port for browsers."""

from __future__ import annotations

import gzip
import re

import pytest

from robotree.tui.errors import NotInstalled, ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.web.door import Door, origin_of
from robotree.tui.web.serving import assets, door_of, handed_over
from robotree.tui.web.session import LARGEST, SMALLEST, message_of, size_of

DOOR = Door("to-command", "to-watch", origins=frozenset({"https://robots.example"}))


@pytest.mark.parametrize(
    "host", ["127.0.0.1:7334", "localhost", "LOCALHOST:80", "[::1]:7334", "robots.example"]
)
def test_this_place_has_the_names_of_loopback_and_that_of_its_proxy(host: str) -> None:
    assert not DOOR.stranger(host)


@pytest.mark.parametrize(
    "host", ["", "evil.example:7334", "127.0.0.1.evil.example", "robots.example.evil:1", "10.0.0.7"]
)
def test_a_foreign_name_that_was_turned_to_this_machine_is_a_stranger(host: str) -> None:
    assert "is not called" in DOOR.stranger(host)


@pytest.mark.parametrize(
    ("origin", "host"),
    [
        ("http://127.0.0.1:7334", "127.0.0.1:7334"),
        ("http://localhost:8080", "localhost:8080"),  # by `ssh -L 8080:127.0.0.1:7334`
        ("https://robots.example", "127.0.0.1:7334"),
    ],
)
def test_our_own_page_may_connect(origin: str, host: str) -> None:
    assert not DOOR.foreign(origin, host)


@pytest.mark.parametrize(
    "origin",
    [
        *("", "null", "http://evil.example", "http://127.0.0.1:9999", "https://127.0.0.1:7334", "file://"),
        *("http://127.0.0.1:7334.evil.example", "http://robots.example", "https://robots.example.evil"),
    ],
)
def test_a_page_of_another_site_or_of_another_port_may_not(origin: str) -> None:
    assert "may not connect" in DOOR.foreign(origin, "127.0.0.1:7334")


def test_a_token_opens_what_it_is_for_and_nothing_like_it_does() -> None:
    assert DOOR.right("to-command") == "command"
    assert DOOR.right("to-watch") == "watch"
    for wrong in ("", "to-comman", "to-command ", "TO-COMMAND", "té-command", "\x00"):
        assert not DOOR.right(wrong)


def test_each_start_has_tokens_of_its_own() -> None:
    doors = [door_of(Line("web"))[0] for _ in range(2)]
    tokens = {one for door in doors for one in (door.command, door.watch)}
    assert len(tokens) == 4
    assert all(len(one) >= 43 for one in tokens), "256 bits"


def test_the_port_is_on_loopback_and_elsewhere_only_what_is_sealed() -> None:
    assert door_of(Line("web"))[1:] == ("127.0.0.1", 7334, None)
    assert door_of(Line("web", {"--listen": "8080"}))[1:3] == ("127.0.0.1", 8080)
    for address in ("0.0.0.0:7334", "robots.example:443", "[2001:db8::1]:80"):
        with pytest.raises(ValueRefused, match="could be read on the way"):
            door_of(Line("web", {"--listen": address}))
    for address in ("", "x", "127.0.0.1:99999", ":80"):
        with pytest.raises(ValueRefused, match="write a port"):
            door_of(Line("web", {"--listen": address or ":"}))
    with pytest.raises(ValueRefused, match="no certificate"):
        door_of(Line("web", {"--listen": "0.0.0.0:7334", "--cert": "/nowhere.pem"}))
    for origin in ("robots.example", "ftp://robots.example", "https://robots.example/page"):
        with pytest.raises(ValueRefused, match="write for example"):
            origin_of(origin)


def test_nothing_that_a_browser_loads_names_another_place() -> None:
    ours = {path: gzip.decompress(one.packed).decode() for path, one in assets().items()}
    for path in ("/", "/page.css", "/page.js", "/xterm.css"):
        loads = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?([^"')\s>]+)""", ours[path])
        assert not [one for one in loads if "//" in one], path
    assert "window.xterm={Terminal:" in ours["/xterm.js"]
    assert "sessionWebsocketUrl" not in ours["/xterm.js"], "the other client is cut off"


def test_a_bundle_that_is_another_one_is_refused_with_what_installs_the_right_one() -> None:
    with pytest.raises(NotInstalled, match=r"textual-serve==1\.1\.3"):
        handed_over("(()=>{})();")


def test_what_a_browser_says_is_bounded() -> None:
    assert size_of([80, 24]) == (80, 24)
    assert size_of([10**9, -5]) == (LARGEST, SMALLEST)
    for wrong in (None, 80, [80], [80, "24"], [80, 24, 3], [True, 24], {"0": 80}, [80.5, 24]):
        assert size_of(wrong) is None
    assert message_of('{"keys": "q"}') == {"keys": "q"}
    for strange in ("", "q", "[1]", b"\xff\xfe", "[" * 10_000, "1e999999"):
        assert message_of(strange) == {}
