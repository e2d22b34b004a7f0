"""For tests: a network in memory, virtual time, and examinations of what transports and lookups promise."""
