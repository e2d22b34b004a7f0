"""The supervisor: the operator's program, as a full screen, as a command line and as session scripts."""
