"""The transport over Zenoh, and what it is made of. Nothing here knows what the bodies say."""
