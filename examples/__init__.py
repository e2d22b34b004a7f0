"""Pages of Python to begin with. Nothing imports them: hosts load these files as source, as they do a user's."""
