"""Services: state machines without I/O. Messages and times go in, messages and events come out.

`now` is always an argument, in seconds on a monotonic clock. The caller carries out what a call returns.
"""
