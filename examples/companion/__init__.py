"""The companion: the page of its actions, and a script that leads it. Loaded as source, as a user's is."""
