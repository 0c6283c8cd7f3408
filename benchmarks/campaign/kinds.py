"""The kinds of faults, by name alone: the command's help lists them without importing what carries them out."""

from __future__ import annotations

BUS_KINDS = ("drop", "delay", "duplicate", "reorder", "corrupt", "bit_error", "stuck", "babble", "bus_off", "cut")
DEVICE_KINDS = ("sensor", "battery")
PROCESS_KINDS = ("loop_killed", "loop_frozen", "server_killed", "engine_silent")
KINDS = (*BUS_KINDS, *DEVICE_KINDS, "drive_error", *PROCESS_KINDS)
