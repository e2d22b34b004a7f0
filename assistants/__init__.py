"""assistants: a realm served to language models by the Model Context Protocol (docs/assistants.md).

marking  texts of robots and people as data: bounded, and without what could look like anything else · pure
tools    the tools that commands become: names, schemas, units and ranges · pure
budget   rates and budgets of one assistant · pure
keys     the keys of assistants, in a file of the realm
record   what assistants asked for and what became of it, in a file of the realm
meter    how far robots move
catalogue  the robots that there are, as they describe themselves
preview  what a call would do, before a person says yes
seat     one assistant: what it sees, its calls, its permits, and their end when it is gone
server   the protocol: tools, resources, tasks
serving  stdio, and streamable HTTP on loopback
"""
