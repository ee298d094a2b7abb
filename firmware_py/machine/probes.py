"""What the two displacement probes may show beside the truth: errors of zero, gain and runout.

They hold as the machine is built until every probe is ``zeroed``: the zero and slow-roll procedure
was done, and what it leaves holds.  Of two probes the worse one counts.  What a rig folder leaves
out is taken from :data:`TYPICAL`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from firmware_py.machine.schema import Machine
from firmware_py.machine.sensors import FastChannel

PROBES: Final = 2
"""The displacement probes are the first channels."""

ZEROED: Final = "zeroed_"
"""Before the name of what is left of an error after the procedure."""

RMS_SHARE: Final = (2.0, 3.0)
ZEROED_RMS_SHARE: Final = (3.0, 5.0)
"""Root mean square of the forward runout over the greatest of one probe (a fraction: it divides
without rounding), as built and after the procedure."""


class ProbeErrors(NamedTuple):
    """Greatest errors of either probe.

    ``gain_share`` is a share of what it shows; ``runout_m`` the amplitude of one order,
    ``forward_runout_m`` the root mean square of the forward first order that both make of it.
    """

    zero_m: float
    gain_share: float
    runout_m: float
    forward_runout_m: float


class Typical(NamedTuple):
    """Errors of an eddy-current probe on a ground shaft, as built and after the procedure."""

    zero_error: float = 2e-6
    gain_error_share: float = 0.03
    runout_m: float = 6e-6
    zeroed_zero_error: float = 0.5e-6
    zeroed_gain_error_share: float = 0.01
    zeroed_runout_m: float = 0.5e-6
    noise_rms: float = 1e-7


TYPICAL: Final = Typical()

FIGURES: Final[Mapping[str, Callable[[FastChannel], float | None]]] = {
    "zero_error": lambda probe: probe.zero_error,
    "gain_error_share": lambda probe: probe.gain_error_share,
    "runout_m": lambda probe: probe.runout_m,
    "zeroed_zero_error": lambda probe: probe.zeroed_zero_error,
    "zeroed_gain_error_share": lambda probe: probe.zeroed_gain_error_share,
    "zeroed_runout_m": lambda probe: probe.zeroed_runout_m,
    "noise_rms": lambda probe: probe.noise_rms,
}
"""Where a probe has each figure."""


def are_zeroed(machine: Machine) -> bool:
    """Whether the zero and slow-roll procedure was done on both probes."""
    return all(probe.zeroed for probe in machine.channel[:PROBES])


def probe_errors(machine: Machine) -> ProbeErrors:
    """What holds now: what the procedure left where it was done, else that of the build."""
    return after_zeroing(machine) if are_zeroed(machine) else as_built(machine)


def as_built(machine: Machine) -> ProbeErrors:
    """Before the zero and slow-roll procedure."""
    runout_m = _worst(machine, "runout_m")
    return ProbeErrors(
        _worst(machine, "zero_error"),
        _worst(machine, "gain_error_share"),
        runout_m,
        _part(runout_m, RMS_SHARE),
    )


def after_zeroing(machine: Machine) -> ProbeErrors:
    """What the zero and slow-roll procedure leaves; runout beside the slow-roll vector."""
    runout_m = _worst(machine, "zeroed_runout_m")
    return ProbeErrors(
        _worst(machine, "zeroed_zero_error"),
        _worst(machine, "zeroed_gain_error_share"),
        runout_m,
        _part(runout_m, ZEROED_RMS_SHARE),
    )


def probe_noise_m(machine: Machine) -> float:
    """Root mean square of a sample's noise."""
    return _worst(machine, "noise_rms")


def error_of(probe: FastChannel, key: str) -> float:
    """The figure ``key`` of one probe, SI: as the rig folder has it, else :data:`TYPICAL`; after
    the procedure no more than before it."""
    found = FIGURES[key](probe)
    if found is not None:
        return float(found)
    typical = float(getattr(TYPICAL, key))
    before = key.removeprefix(ZEROED)
    return typical if before == key else min(typical, error_of(probe, before))


def _worst(machine: Machine, key: str) -> float:
    return max(error_of(probe, key) for probe in machine.channel[:PROBES])


def _part(value: float, share: tuple[float, float]) -> float:
    return value * share[0] / share[1]
