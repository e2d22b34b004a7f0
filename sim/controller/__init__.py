"""One robot's controller: its cell, its firmware, the inbox of frames, and what it keeps over a restart."""
