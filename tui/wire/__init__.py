"""`robotree wire …`: record, inspect, replay and measure what crosses the wire; no agents are needed.

Each verb is a module of its own, of the name of its second word. Here is only what opens, reads and prints;
what is computed is computed in `robotree.protocol`.
"""
