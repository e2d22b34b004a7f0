"""proxy: between agents and wire.

A *robot proxy* stands for one robot: agents call its commands, and it has the robot's controller carry them
out over MAVLink. A *view* stands for the cameras and instruments around a robot.

    motion · translate · guard · outcome · twin     pure: conversions between both sides, and their limits
    session · desired_mode · restart                pure: the session with one controller
    connection · pending_goals · mode_requests      the shell: links, and what threads of commands wait for
    robot_proxy                                     what every kind of robot has in common
    arm · rover · kinds                             the kinds by name, and those in files of other people
    view                                            pictures and readings of a workspace
    agent                                           all of it on a network of agents

What an author of a kind needs is here; docs/bring-your-own-robot.md shows how it is used.
"""

from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Hold, Motion, Request
from robotree.proxy.robot_proxy import RobotProxy

__all__ = ["Hold", "Limits", "Motion", "Request", "RobotProxy", "Span"]
