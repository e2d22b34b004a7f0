"""The full screen in a browser: a page on loopback, a session for each tab, and what each is allowed.

door     who is let in: the names of this place, where a page came from, tokens
assets   what a browser loads, all of it from here
session  a process with the full screen at a terminal of its own, for as long as a tab is there
serving  the port
"""
