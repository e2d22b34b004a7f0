"""Links: where bytes go in and out. The contract is in link.py, addresses are in url.py."""
