"""The compliant arm: model and world below, control law and verbs above, telemetry beside them."""
