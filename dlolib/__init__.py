"""dlolib: identify a rope's stiffness from RGB-D recordings and learn to shape it without contact.

Importing it is cheap: Taichi, Open3D and MuJoCo load with the subpackages that use them.
"""

__version__ = "0.1.0"
