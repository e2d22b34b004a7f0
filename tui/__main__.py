"""`python -m robotree.tui` is the command line `robotree`."""

from __future__ import annotations

from robotree.tui.cli import program

if __name__ == "__main__":
    program()
