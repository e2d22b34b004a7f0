"""Several machines: who belongs to a realm, and the sealed way between its gateways.

Nothing on a machine without a gateway imports it.
"""
