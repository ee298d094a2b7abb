"""Compiled kernels: the same bits whatever was compiled before, on every fresh installation."""

from __future__ import annotations

import importlib
import os
import pkgutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from numba.core.caching import IndexDataCacheFile
from numba.core.dispatcher import Dispatcher

import sim_hil

SIMULATOR = ("film", "rotor", "sensors")

MACHINE = """
import hashlib
from sim_hil.plant.build import Build
from sim_hil.plant.duty import Duty
from sim_hil.plant.machine import SimulatedMachine
from sim_hil.rigs import load_rig
from sim_hil.plant.runs import run
rig = load_rig("bench")
machine = SimulatedMachine(rig, Build.nominal(rig), 1)
truth = run(machine, Duty.hold(6000.0, 60.0), 0.3, clearance=60e-6).truth
print(hashlib.sha256(truth.tobytes()).hexdigest())
"""
ROTOR_ON_FED_FILM_FIRST = """
from sim_hil.plant.duty import Duty
from sim_hil.plant.response import simulate
from sim_hil.rigs import load_rig
simulate(load_rig("bench"), Duty.hold(6000.0, 60.0), clearance=60e-6, seconds=0.02, fed=True)
simulate(load_rig("bench"), Duty.hold(6000.0, 60.0), clearance=60e-6, seconds=0.02)
"""


def _kernels() -> list[Dispatcher]:
    found = []
    for package in SIMULATOR:
        for info in pkgutil.iter_modules(
            [str(Path(sim_hil.__file__).parent / package)], f"sim_hil.{package}."
        ):
            members = vars(importlib.import_module(info.name)).values()
            found += [member for member in members if isinstance(member, Dispatcher)]
    return found


def test_no_kernel_relaxes_ieee_arithmetic_and_each_says_all_of_its_options() -> None:
    kernels = [kernel for kernel in _kernels() if not kernel.targetoptions.get("parallel")]
    assert len(kernels) > 50
    for kernel in kernels:
        options = kernel.targetoptions
        assert options.get("fastmath") is False, kernel.py_func.__qualname__
        assert {"error_model", "_nrt"} <= set(options), kernel.py_func.__qualname__


@pytest.mark.slow
def test_what_is_compiled_first_does_not_change_a_bit(tmp_path: Path) -> None:
    def said(cache: str, *programs: str) -> str:
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / cache)}
        for program in programs:
            done = subprocess.run(
                [sys.executable, "-c", program],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
                timeout=300,
            )
        return done.stdout

    assert said("machine", MACHINE) == said("rotor", ROTOR_ON_FED_FILM_FIRST, MACHINE)


def test_kernels_that_are_compiled_at_the_same_time_are_kept_each_under_its_signature(
    tmp_path: Path,
) -> None:
    def save(number: int) -> None:
        IndexDataCacheFile(str(tmp_path), "kernel", "stamp").save(f"signature {number}", number)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(save, range(40)))
    kept = IndexDataCacheFile(str(tmp_path), "kernel", "stamp")
    assert [kept.load(f"signature {number}") for number in range(40)] == list(range(40))
