"""Where something should be next: jerk-limited paths, pursuits of moving targets, the leash. Pure."""
