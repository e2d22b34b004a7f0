"""The pages of the full screen."""
