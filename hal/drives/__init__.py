"""Drive families: how each speaks on the bus. One family a file, with the DBC file that describes its frames."""

from pathlib import Path

DBC_FILES = {"limb_fd": Path(__file__).with_name("limb_fd.dbc")}
"""Family → DBC file."""
