"""The transport between machines, over Eclipse Zenoh. Nothing on one machine imports it."""
