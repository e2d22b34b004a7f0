"""Pages of Python to begin with. Nothing imports them: a host loads them as source, as it does a user's."""
