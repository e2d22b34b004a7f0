"""The extras of pyproject.toml, which are installed apart from robotree's core, and what each brings.

A robot, a proxy and a host need the core alone (decision 0058). Whatever needs more asks here, so that what
is missing is named with the command that installs it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from typing import NamedTuple

MODULES: Mapping[str, tuple[str, ...]] = {
    "pictures": ("numpy", "PIL"),
    "sim": ("coal", "mujoco", "numpy", "PIL", "pinocchio", "ruckig"),
    "tui": ("PIL", "rich", "textual"),
    "scripts": ("clips",),
    "wire": ("mcap", "pymavlink", "zstandard"),
    "machines": ("cryptography", "zenoh"),
    "postgres": ("psycopg",),
    "services": ("clips", "cv2", "espeakng_loader", "numpy", "pocketsphinx"),
    "foxglove": ("websockets",),
    "lerobot": ("PIL", "pyarrow"),
    "mcp": ("mcp", "mcp_types", "uvicorn"),
    "web": ("textual_serve", "websockets"),
    "languages": ("arabic_reshaper", "bidi"),
    "testing": ("greenlet", "pytest"),
}
"""The modules of other people that we import, by the extra that brings them."""

LIBRARIES: Mapping[str, Mapping[str, str]] = {"sim": {"libgomp.so.1": "libgomp1"}}
"""By extra: libraries that its wheels expect of the system, and the packages of Debian and Ubuntu that have
them. Pinocchio's wheel is built for OpenMP, and does not bring it."""


class NotThere(NamedTuple):
    """Something that is not installed on this machine."""

    thing: str
    """Its description in words."""
    remedy: str
    """The command that installs it."""

    def __str__(self) -> str:
        """Return both, as the end of a sentence."""
        return f"{self.thing} is not installed; install it: `{self.remedy}`"


def lacks(extra: str) -> Iterator[NotThere]:
    """Give what an extra needs and this machine does not have.

    Args:
        extra: one of `MODULES`.
    """
    if missing := [module for module in MODULES[extra] if find_spec(module) is None]:
        yield NotThere(f"{' and '.join(missing)} (robotree[{extra}])", installation(extra))
    for library, package in LIBRARIES.get(extra, {}).items():
        if not _loads(library):
            root = "" if os.geteuid() == 0 else "sudo "
            yield NotThere(f"the system's library {library}", f"{root}apt-get install {package}")


def lack_of(error: ImportError) -> NotThere | None:
    """Return what would have to be installed for an import not to fail; None: it is nothing of an extra."""
    top = (error.name or "").partition(".")[0]
    for extra, modules in MODULES.items():
        if top in modules:
            return next(lacks(extra), None)
    return None


def explained(error: ImportError) -> ImportError:
    """Return an error that names what installs the module which was not found, where an extra brings it."""
    lack = lack_of(error)
    return ImportError(str(lack), name=error.name) if lack else error


def installation(extra: str = "") -> str:
    """Return the command that installs an extra for the interpreter that runs this; "": the core."""
    wanted = f"'robotree[{extra}]'" if extra else "robotree"
    if find_spec("pip") is None:
        return f"uv pip install --python {sys.executable} {wanted}"
    return f"{sys.executable} -m pip install {wanted}"


def _loads(library: str) -> bool:
    """Whether the system finds a library."""
    from ctypes import CDLL

    try:
        CDLL(library)
    except OSError:
        return False
    return True
