"""Virtual robots (nothing to do with goggles): agents that wrap other robots' commands into coarser ones."""
