"""What stands above all agents: a whole realm by name, for people and programs."""
