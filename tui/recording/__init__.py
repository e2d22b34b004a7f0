"""Recordings of a realm: what robots said, did and read, and the pictures, in one file of MCAP.

tape       the file: written as it comes, read also where it is cut off.
recorder   from a living realm into a file: `robotree record`
summary    what a recording holds, in words
comparing  where two recordings differ
report     the same as Markdown, with pictures
replayed   what persons asked for in it, as a session script
exports    the verbs that make a file of another format: `robotree export`
"""
