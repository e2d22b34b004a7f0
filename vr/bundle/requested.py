"""A page as it stands in a request, and back. Pure."""

from __future__ import annotations

from robotree.vr.base.requests import Create
from robotree.vr.bundle.bundle import Bundle


def bundle_of(page: Create) -> Bundle:
    """Return the page of a request."""
    return Bundle(page.source, page.path, page.wanted, page.files, page.signed, page.sender)


def request_of(bundle: Bundle, name: str = "", origin: str = "") -> Create:
    """Return a page as it stands in a request."""
    return Create(
        name=name,
        path=bundle.path,
        source=bundle.source,
        wanted=bundle.wanted,
        files=bundle.files,
        signed=bundle.signed,
        sender=bundle.sender,
        origin=origin,
    )
