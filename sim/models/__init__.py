"""Device models, a module each: `spec()`, the device as MuJoCo reads it, and `bind()`, its ports in a cell.

Devices are composed into a cell by `scenery`; every name of a device is then prefixed with the device's own,
`arm/j1`.
"""
