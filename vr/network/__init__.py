"""The transports between processes: our own on one machine, Zenoh beyond it. They carry bytes."""
