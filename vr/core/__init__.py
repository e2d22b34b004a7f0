"""The robot as plain data, and the one pure machine that changes it."""
