"""What the supervisor sees of its realm, and how that reads as text. No screen in here."""
