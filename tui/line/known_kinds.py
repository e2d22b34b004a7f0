"""What scripts are compared with: the kinds of robots that come with robotree, and their commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec
    from robotree.vr.scripts.program import Program


def known_kinds() -> dict[str, dict[str, CommandSpec]]:
    """Return the commands of the kinds of robots that come with robotree, by name of the kind."""
    from robotree import kinds
    from robotree.vr.author.kind import promises_of

    return {name: {one.name: one for one in promises_of(getattr(kinds, name))} for name in kinds.__all__}


def check_script(program: Program) -> None:
    """Refuse what a script says of those kinds and cannot be meant.

    Raises:
        BrokenScript: there is something, and where.
    """
    from robotree.kinds import STREAMS
    from robotree.vr.scripts.known import check_known

    check_known(program, known_kinds(), STREAMS)


def checked_script(source: str, name: str) -> int:
    """Check a script against those kinds; returns how many rules it has.

    Args:
        source: the script.
        name: of its file, for what is told.

    Raises:
        VrError: something is wrong, with line and column.
    """
    from robotree.vr.scripts.engine import Engine
    from robotree.vr.scripts.script import read_program

    program = read_program(source, name)
    check_script(program)
    Engine(program)  # CLIPS takes each rule
    return len(program.rules)
