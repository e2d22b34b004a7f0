"""The holonomic rover: model and world below, servo and verbs above, telemetry beside them."""
