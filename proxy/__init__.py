"""proxy: the doors between agents and wire.

A *robot proxy* stands for one robot: agents call its commands, and it has the robot's controller carry them
out over MAVLink. A *view* stands for the cameras and instruments around a robot.

    motion · translate · guard · outcome · twin     pure: words of one side into words of the other
    session · backoff                               pure: the conversation with one controller
    connection · errand                             the shell: links, and the threads that commands run in
    robot_proxy                                     what every kind of robot has in common
    arm · rover                                     the kinds; a new one is one module
    kinds · kind_file                               found by name, and in files of other people
    view                                            pictures and readings of a workspace
    agent                                           all of it on a network of agents

What an author of a kind needs is here; docs/bring-your-own-robot.md shows how it is used.
"""

from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Hold, Motion, Request
from robotree.proxy.robot_proxy import RobotProxy

__all__ = ["Hold", "Limits", "Motion", "Request", "RobotProxy", "Span"]
