"""Those who live among the others: the agent of a robot, the host of many, the agent of a view."""
