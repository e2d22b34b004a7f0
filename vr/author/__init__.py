"""What the author of a page uses: robots, commands, children, settings, and what a running command can do."""
