"""The whole system in one process and in virtual time, from one seed: same seed, same trace."""
