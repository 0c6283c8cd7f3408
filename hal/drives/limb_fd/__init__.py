"""Where LimbProtocol was; see hal.drives.protocol."""

from hal.drives import DBC_FILES
from hal.drives.protocol import DriveTargets, LimbProtocol

__all__ = ["DBC", "DriveTargets", "LimbProtocol"]
DBC = DBC_FILES["limb_fd"]
