"""Lookup: any number of services that hold leased listings, and the two sides that use them.

A service is soft state and may die at any moment. `Registrar` keeps agents listed in all of them,
`Directory` sees the union of all of them; neither notices when one of several is lost.
"""
