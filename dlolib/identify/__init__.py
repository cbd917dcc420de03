"""From recordings to a rope's stiffness, with intervals."""

from dlolib.identify.descent import Descended, DescentSettings, descend
from dlolib.identify.identify import FINER, Identified, IdentifySettings, identify, particles_for
from dlolib.identify.output import summary, write_identified

__all__ = [
    "FINER",
    "Descended",
    "DescentSettings",
    "Identified",
    "IdentifySettings",
    "descend",
    "identify",
    "particles_for",
    "summary",
    "write_identified",
]
