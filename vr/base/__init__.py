"""What all other folders build on: addresses, values, messages, errors, and the contract of a transport."""
