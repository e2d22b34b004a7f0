"""`robotree info` and `robotree doctor`: what is installed and set here, and why a robot is not seen."""
