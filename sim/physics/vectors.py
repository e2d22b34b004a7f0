"""The array types of the simulator. Shapes and units stand in the docstrings that use them."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Vector: TypeAlias = NDArray[np.float64]
"""One dimension of 64-bit floats."""
Matrix: TypeAlias = NDArray[np.float64]
"""Two dimensions of 64-bit floats."""
Picture: TypeAlias = NDArray[np.uint8]
"""(height, width, 3) red, green, blue."""
