"""The type of numerical arrays in annotations."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]  # docstrings say shape and unit
