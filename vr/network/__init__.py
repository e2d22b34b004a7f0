"""The transports between processes: our own sockets on one machine. They carry bytes."""
