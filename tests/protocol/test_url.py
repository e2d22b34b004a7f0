"""An address either means one thing or is refused with a sentence that says what to write."""

from __future__ import annotations

import pytest

from robotree.protocol.errors import BadUrl, LinkRefused
from robotree.protocol.links.url import SCHEMES, connect, instead, listen, parse, require_loopback
from robotree.protocol.testing import RecordingHandler


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("tcp:127.0.0.1:5760", "127.0.0.1", 5760),
        ("tcp:5760", "127.0.0.1", 5760),
        ("tcp::5760", "127.0.0.1", 5760),
        ("tcp:cell.example:0", "cell.example", 0),
        ("tcp:[::1]:5760", "::1", 5760),
    ],
)
def test_a_host_and_a_port(text: str, host: str, port: int) -> None:
    assert parse(text).host_and_port() == (host, port)


def test_options_are_taken_apart_and_unknown_ones_refused() -> None:
    url = parse("tcp:5760?a=1&b=x%20y")
    assert url.options == {"a": "1", "b": "x y"}
    assert url.only("a", "b", "c") == url.options
    with pytest.raises(BadUrl, match="option 'b' is unknown; there is a"):
        url.only("a")


@pytest.mark.parametrize("url", ["tcp:127.0.0.1:0?fd=1", "udp:127.0.0.1:0?fd=1"])
async def test_an_option_of_another_scheme_is_refused_at_both_ends(url: str) -> None:
    for end in (connect, listen):
        with pytest.raises(BadUrl, match="option 'fd' is unknown"):
            await end(url, RecordingHandler)


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("", "begin it with"),
        ("5760", "begin it with"),
        ("http://x", "begin it with"),
        ("tcp:", "is no port"),
        ("tcp:host", "is no port"),
        ("tcp:host:", "is no port"),
        ("tcp:host:65536", "is no port"),
        ("tcp:host:-1", "is no port"),
        ("tcp:host:٣", "is no port"),
        ("tcp:::1:5760", "in brackets"),
        ("tcp:5760?fd", "as ?name=value"),
    ],
)
def test_an_address_that_means_nothing_is_refused(text: str, advice: str) -> None:
    with pytest.raises(BadUrl, match=advice.replace("?", r"\?")) as refused:
        parse(text).host_and_port()
    assert refused.value.address == text


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "example.org", ""])  # noqa: S104  refused below
async def test_nobody_listens_to_the_world_by_accident(host: str) -> None:
    with pytest.raises(BadUrl, match="can be reached from outside"):
        require_loopback("tcp:…", host, exposed=False)
    require_loopback("tcp:…", host, exposed=True)
    if host:
        with pytest.raises(BadUrl):
            await listen(f"tcp:[{host}]:0", RecordingHandler)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_is_always_allowed(host: str) -> None:
    require_loopback("tcp:…", host, exposed=False)
    with pytest.raises(BadUrl):
        require_loopback("tcp:…", "192.0.2.1", exposed=False)


def test_the_advice_for_a_taken_address_fits_its_scheme() -> None:
    assert all(instead(f"{scheme}:x") != instead("x") for scheme in SCHEMES)
    assert "port (0: any free one)" in instead("udp:127.0.0.1:14550")
    assert "?node=N" in instead("can:robotree/cell?node=1")
    assert "device" in instead("serial:/dev/ttyUSB0")


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
@pytest.mark.parametrize("host", ["a..b", "x" * 64, "a\0b", "\udcff"], ids=["empty", "long", "nul", "half"])
async def test_a_host_that_can_have_no_such_name_is_refused(scheme: str, host: str) -> None:
    with pytest.raises(LinkRefused, match="no machine can have that name"):
        await connect(f"{scheme}:{host}:5760", RecordingHandler)
    with pytest.raises(LinkRefused, match="no machine can have that name"):
        await listen(f"{scheme}:{host}:0", RecordingHandler, exposed=True)
