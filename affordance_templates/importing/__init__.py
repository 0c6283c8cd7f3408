"""Templates of others: MIT's OTDF (Fallon et al. 2015, §5) and NASA's affordance templates (.atdf's XML, the older JSON).

What has a counterpart becomes a template of ours; the rest is listed, nothing is dropped in silence.
"""

from affordance_templates.importing.formats import read
from affordance_templates.importing.imported import Imported

__all__ = ["Imported", "read"]
