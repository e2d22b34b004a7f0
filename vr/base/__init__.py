"""The base of all other folders: addresses, values, messages, errors, and the contract of a transport."""
