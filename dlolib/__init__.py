"""dlolib: identify a rope's stiffness from RGB-D recordings and learn to shape it without contact.

Importing it is cheap: Taichi, Open3D and MuJoCo load with the subpackages that use them.
"""

import os

# Linear algebra by one thread of each process, or the last digits would depend on the number of cores; what
# is worth sharing out is shared out among processes. NumPy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
