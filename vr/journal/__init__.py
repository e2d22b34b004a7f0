"""What a host keeps of its robots, so that they go on after a crash: a log, its reader, a barrier."""
