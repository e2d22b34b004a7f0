"""client: how a Python program sees and commands a realm whose robots run.

joining       enter a realm and leave it
asynchronous  the realm and its robots for asyncio, short in a notebook and printed as trees
blocking      the same for scripts and notebooks, on an event loop in a thread of its own
"""
