"""Robots in processes of their own: the pipe to one, its judge, its limits, and the host's side of it.

A robot *apart* has no way to the network but one socket, to its host. The host judges each frame that comes
from there (`judge.py`) and carries out what a robot may ask for (`apart.py`). `agents/inside.py` is the other
end, `agents/zygote.py` makes such processes quickly.
"""
