"""Whether this machine has what a verb needs beyond the core of robotree.

`python -m robotree.tui.line.installed` looks for what all verbs together need of the system (`make setup`).
"""

from __future__ import annotations

from robotree.tui.errors import NotInstalled


def require(verb: str, *extras: str) -> None:
    """See that what a verb needs is installed, before it begins.

    Args:
        verb: as people write it.
        *extras: of pyproject.toml; see `Action.needs`.

    Raises:
        NotInstalled: something is missing; the error names the command that installs it.
    """
    from robotree.vr.base.extras import lacks

    for extra in extras:
        for lack in lacks(extra):
            raise NotInstalled(verb, lack.thing, lack.remedy)


def lacking(verb: str, error: ImportError) -> NotInstalled | None:
    """Return what people are told about a failed import; None: it is no part of an extra."""
    from robotree.vr.base.extras import lack_of

    lack = lack_of(error)
    return NotInstalled(verb, lack.thing, lack.remedy) if lack else None


def main() -> None:
    """Name each thing that is missing on this machine, one to a line."""
    from robotree.tui.terminal import note
    from robotree.vr.base.extras import MODULES, lacks

    for extra in MODULES:
        for lack in lacks(extra):
            note(f"robotree[{extra}]: {lack}")


if __name__ == "__main__":
    main()
