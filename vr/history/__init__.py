"""The history of robots, kept behind their hosts' journals in files that people can query and verify."""
