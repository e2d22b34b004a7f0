"""What a browser loads: our page, and the terminal for browsers xterm.js; nothing comes from elsewhere.

xterm.js (MIT) comes in a bundle with the package textual-serve. The end of that bundle is a client for
textual-serve's own server, whose page loads a font from another host, which has no token and cannot be closed
to others; it is cut off, and what it is made of is handed to our page instead (decision 0130).
"""

from __future__ import annotations

import gzip
from importlib.resources import files
from typing import NamedTuple

import textual_serve

from robotree.tui.errors import NotInstalled

BEGINS, TERMINAL, FIT, WIDTHS = (
    "class w{constructor(e,t){this.element=e",
    "v.Terminal",
    "g.FitAddon",
    "C.Unicode11Addon",
)
"""How the client in the bundle of textual-serve 1.1.3 begins, and what it is made of."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self';"
    " img-src 'self' data:; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What the page may load (CSP 3). xterm.js writes the colours of cells into a style sheet of its own."""


class Asset(NamedTuple):
    """One file, as it is sent."""

    kind: str
    packed: bytes
    """By gzip."""


def assets() -> dict[str, Asset]:
    """Return what is served, by path.

    Raises:
        NotInstalled: the bundle is not the one that is known.
    """
    ours, theirs = files("robotree.tui.web").joinpath("page"), files(textual_serve).joinpath("static")
    page = Asset("text/html", _packed(ours.joinpath("index.html").read_bytes()))
    return {
        "/": page,
        "/user": page,
        "/page.css": Asset("text/css", _packed(ours.joinpath("page.css").read_bytes())),
        "/page.js": Asset("text/javascript", _packed(ours.joinpath("page.js").read_bytes())),
        "/xterm.css": Asset("text/css", _packed(theirs.joinpath("css", "xterm.css").read_bytes())),
        "/xterm.js": Asset(
            "text/javascript",
            _packed(handed_over(theirs.joinpath("js", "textual.js").read_text("utf-8")).encode()),
        ),
    }


def handed_over(bundle: str) -> str:
    """Return the bundle without the client at its end, which hands its parts over as `window.xterm`.

    Raises:
        NotInstalled: the bundle is another one.
    """
    whole, found, client = bundle.rpartition(BEGINS)
    if not found or not all(part in client for part in (TERMINAL, FIT, WIDTHS)):
        raise NotInstalled("web", "textual-serve 1.1.3", "pip install 'textual-serve==1.1.3'")
    parts = f"window.xterm={{Terminal:{TERMINAL},FitAddon:{FIT},Unicode11Addon:{WIDTHS}}}"
    return f"{whole}{parts}}})()}})();"


def _packed(content: bytes) -> bytes:
    return gzip.compress(content, mtime=0)
