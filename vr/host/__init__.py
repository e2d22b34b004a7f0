"""The only place where agents meet a network: transports, and the loops that serve requests over them."""
