"""Services: state machines without I/O. Messages and moments go in, messages and events come out.

`now` is always an argument, in seconds on a clock that never jumps. What a call returns, the caller carries
out.
"""
