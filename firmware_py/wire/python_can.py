"""python-can without its reader of ASAM MDF, which this device does not need.

``import can`` brings in every format of log files whose library is installed.  Beside the trainers
that is asammdf, with pandas and sympy: more than a second of processor time in every process that
opens a bus, and a guard that starts again is blind for as long.
"""

from __future__ import annotations

import sys
from typing import Final

_READER_OF_MDF: Final = "asammdf"

_left_out = _READER_OF_MDF not in sys.modules
if _left_out:
    sys.modules[_READER_OF_MDF] = None  # type: ignore[assignment]  # as if it were not installed
try:
    import can
finally:
    if _left_out:
        del sys.modules[_READER_OF_MDF]

__all__ = ["can"]
