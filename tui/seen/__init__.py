"""The supervisor's view of its realm, and its texts. No screen in here."""
