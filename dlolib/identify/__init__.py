"""From recordings to a rope's stiffness, with intervals."""

from dlolib.identify.descent import Descended, DescentSettings, descend
from dlolib.identify.identify import Identified, IdentifySettings, identify
from dlolib.identify.output import summary, write_identified

__all__ = [
    "Descended",
    "DescentSettings",
    "Identified",
    "IdentifySettings",
    "descend",
    "identify",
    "summary",
    "write_identified",
]
