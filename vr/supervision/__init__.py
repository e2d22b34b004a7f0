"""The client of a whole realm by name, for people and programs."""
