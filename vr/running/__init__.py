"""An author's code at work: in threads that can be interrupted, one that moves at a time, to its outcome."""
