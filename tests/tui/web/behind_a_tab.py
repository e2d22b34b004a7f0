"""Stands for the program behind a tab (`robotree.tui.behind_a_tab`): draws and hears, and loads nothing."""

from __future__ import annotations

import fcntl
import json
import os
import sys
import termios

fcntl.ioctl(0, termios.TIOCSCTTY, 0)
with os.fdopen(int(sys.argv[1]), "rb") as line:
    wanted = line.readline()
if wanted:
    os.write(1, b"realm tabs (read-only)" if "--readonly" in json.loads(wanted) else b"realm tabs")
    while keys := os.read(0, 4096):
        if b"?" in keys:
            os.write(1, b"On every page, but not")
