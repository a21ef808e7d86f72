"""What every robot gives to the rest of the suite."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Model(NamedTuple):
    """Inertia and Coriolis matrix in actuated coordinates at one state: M thdd + Q thd = tau.

    Attributes:
        M: Inertia matrix [kg m^2], shape (n, n).
        Q: Coriolis and centrifugal matrix [kg m^2/s], shape (n, n); Mdot - 2 Q is skew-symmetric.
    """

    M: Array
    Q: Array
