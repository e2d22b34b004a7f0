"""The choices on the command line of pytest; loads nothing."""

seed: int | None = None
"""The only seed to be played; None: all that the tests name."""
