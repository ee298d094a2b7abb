"""How long the first call takes: with an empty compile cache, and with a filled one."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from typing import Final

_PROGRAM: Final = """
import time
start = time.perf_counter()
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import simulate
from sim_hil.rigs import load_rig
imported = time.perf_counter()
simulate(load_rig("bench"), Duty.hold(3000, 100, 0.01), clearance=60e-6)
print(imported - start, time.perf_counter() - imported)
"""


def start_times() -> dict[str, float]:
    """Seconds to import and to the first result of `simulate`, cold and warm, each in a process of
    its own."""
    found: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as cache:
        for name in ("cold", "warm"):
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
            done = subprocess.run(
                [sys.executable, "-c", _PROGRAM],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            found[f"import_{name}_s"], found[f"first_call_{name}_s"] = map(
                float, done.stdout.split()
            )
    return found
