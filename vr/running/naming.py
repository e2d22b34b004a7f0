"""What the text of a bundle is called in tracebacks, `PATH@VERSION`: no two versions are mixed up."""

from __future__ import annotations

import re

_VERSION = re.compile(r"@[0-9a-f]{8}\Z")


def file_in_tracebacks(path: str, digest: str) -> str:
    """Return what a source is called: the same only for the same text at the same place.

    Args:
        path: where its author keeps it.
        digest: hash of the source, in hex.
    """
    return f"{path}@{digest[:8]}"


def authors_file(file: str) -> str:
    """Return the path that an author knows, of a file as tracebacks call it."""
    return _VERSION.sub("", file)
