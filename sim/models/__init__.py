"""Device models: one module each, with `spec()` (the device as MuJoCo reads it) and `bind()` (its ports in a model).

Devices are composed into a cell by `scenery`; every name of a device is then prefixed with the device's own, `arm/j1`.
"""
