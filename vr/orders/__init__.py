"""Directories: lookup services with a durable memory of robots, orders and results.

`store.py` keeps records in a file, `book.py` has the rules, `service.py` serves them and exchanges them with
other directories, `ledger.py` is the memory of a robot of the orders that it has begun.
"""
