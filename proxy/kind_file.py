"""A kind of robot from a file of somebody's own: `robotree proxy conveyor.py belt-1 …`.

The file is the user's, named on the user's command line and run in the user's own process. It is loaded as
the source of a virtual robot is, so that whatever is wrong with it is one sentence with the line.
"""

from __future__ import annotations

from typing import Any

from robotree.proxy.errors import NoKind, SeveralKinds
from robotree.proxy.robot_proxy import RobotProxy
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.choice import NotOne, only_class
from robotree.vr.bundle.loader import load_module
from robotree.vr.bundle.loader import make as make_robot

SUFFIX = ".py"


def is_file(kind: str) -> bool:
    """Whether a word means a file, `FILE.py` or `FILE.py:CLASS`, rather than the name of a kind."""
    return _split(kind)[0].endswith(SUFFIX)


def load(kind: str) -> type[RobotProxy]:
    """Run a file and return the kind that it defines. Blocks until the file has run.

    Args:
        kind: `FILE.py`, or `FILE.py:CLASS` when there are several.

    Raises:
        NoSuchFile: it cannot be read.
        BrokenSource: it does not compile, raises, does not end, or declares a command wrongly.
        NoKind: it defines no kind of robot, or none of the name wanted.
        SeveralKinds: it defines several, and none was named.
    """
    path, wanted = _split(kind)
    bundle = Bundle.read(path)
    module = load_module(bundle.source, path, bundle.hash)
    try:
        return only_class(module, RobotProxy, path, wanted)
    except NotOne as error:
        if error.known:
            raise SeveralKinds(path=path, known=", ".join(error.known)) from None
        raise NoKind(path=path, wanted=error.named) from None


def make(kind: str, name: str, url: str, **options: Any) -> RobotProxy:
    """Return the proxy of one robot of a kind from a file. Blocks until its constructor has run.

    Args:
        kind: as for `load`.
        name: what it is called.
        url: where its controller listens.
        **options: as `RobotProxy` takes them.

    Raises:
        BadName: that cannot be a name.
        BundleError: the file cannot be used, or the constructor raises or does not end.
        ProxyError: see `load`.
    """
    cls, path = load(kind), _split(kind)[0]
    return make_robot(cls, lambda: cls(name, url, **options), name, path, takes="name, url, **options")


def _split(kind: str) -> tuple[str, str]:
    path, colon, wanted = kind.rpartition(":")
    return (path, wanted) if colon else (kind, "")
