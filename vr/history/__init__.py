"""What robots did, kept behind their hosts' journals in files that people can ask and verify."""
