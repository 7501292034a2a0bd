# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""Array types besides the package's own `Array` of float64."""

import numpy as np
import numpy.typing as npt

Index = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]
