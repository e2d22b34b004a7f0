"""The processes of a realm: joining it, being one of them, starting others, what they keep."""
