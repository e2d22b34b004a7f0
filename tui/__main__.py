"""`python -m robotree.tui` is the command line `robotree`."""

from __future__ import annotations

from robotree.tui.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
