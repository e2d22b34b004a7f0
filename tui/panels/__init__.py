"""Panels that are programs: Textual widgets that a page brings, in a process of this machine behind a pipe.

The process has one socket, to the screen. It draws into a region of cells, hears keys and clicks there, and
asks for commands of its own robot. `author.py` is what a panel is written with, `inside.py` its process,
`outside.py` the screen's side, which judges each frame (`judge.py`) and ends what misbehaves.
"""
