"""Realms of several machines on the command line: keys, hubs and gateways."""
