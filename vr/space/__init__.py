"""The space of a realm: entries that robots write, read and take, with leases, transactions and fences."""
