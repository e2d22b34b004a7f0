"""robotree: supervise robots through virtual robots.

    from robotree import connect

    with connect() as realm:
        arm = realm["arm-1"]
        arm.go_to(x="30 cm", y=0, z=0.4, twist=0)

`connect` joins a realm whose robots run; `connect_async` does it for asyncio. Pages of virtual robots import
from `robotree.vr`, tests of pages from `robotree.testing`; the command line is `robotree`.
"""

TYPE_CHECKING = False
"""As `typing.TYPE_CHECKING`, which would take 5 ms to import: this file is read before any other."""

if TYPE_CHECKING:
    from robotree.client.asynchronous import connect_async
    from robotree.client.blocking import connect

__all__ = ["connect", "connect_async"]

_FROM = {"connect": "blocking", "connect_async": "asynchronous"}
"""The module of `robotree.client` that a name comes from; it is loaded when the name is first used."""


def __getattr__(name: str) -> object:
    """Load a name that is used for the first time."""
    if name not in _FROM:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    found = globals()[name] = getattr(import_module(f"robotree.client.{_FROM[name]}"), name)
    return found


def __dir__() -> list[str]:
    """Return the names that can be imported."""
    return sorted({*globals(), *__all__})
