"""Reference motion: jerk-limited paths, pursuits of moving targets, and the follower that waits. Pure."""
