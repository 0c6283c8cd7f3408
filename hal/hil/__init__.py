"""Hardware in the loop for tests: a pytest plugin with the bus, the plant, the daemon and the robot as fixtures (docs/hil.md)."""
