"""The names for authors of pages: robots, commands, children, settings, and a running command's functions."""
