"""What the shield has against a machine, asked before a device starts on it."""

from __future__ import annotations

from collections.abc import Iterator

from firmware_py.config import Config
from firmware_py.guard.envelope.shield import Shield
from firmware_py.machine.groove import Groove
from firmware_py.machine.parts import monitor_only


def check_safe(config: Config) -> Iterator[tuple[str, object, str]]:
    """What the guard's laws have against the machine: key, value, and cause with the next step.

    No fixed clearance admissible over the declared range, or the retreat clearance not among them.
    A machine that is monitor only has no envelope to prove.
    """
    if monitor_only(config.machine):
        return
    shield = Shield(config)
    fixed = shield.fixed_range()
    safe_um = config.machine.actuator.safe_radial_clearance_um
    o = config.machine.operating
    declared = (
        f"{o.speed_min_rpm:g} .. {o.speed_max_rpm:g} rpm, {o.load_min_N:g} .. {o.load_max_N:g} N, "
        f"oil up to {config.machine.lubricant.inlet_max_C:g} degC"
    )
    pressed_N, feed = Groove(config.machine).added_N[1], ""
    if pressed_N > 0.0:
        declared += (
            f", and up to {pressed_N:g} N by the groove at "
            f"{config.machine.feed.pressure_max_bar:g} bar"
        )
        feed = ", machine.feed.pressure_max_bar"
    if fixed is None:
        yield (
            "machine.operating",
            None,
            (
                f"no fixed clearance is admissible over {declared}; narrow "
                f"machine.operating.*{feed} or machine.lubricant.inlet_max_C, or lower "
                "limits.min_film_um"
            ),
        )
    elif not shield.admits_fixed(safe_um * 1e-6):
        yield (
            "machine.actuator.safe_radial_clearance_um",
            safe_um,
            (
                f"not admissible over {declared}; choose {fixed[0] * 1e6:.0f} .. "
                f"{fixed[1] * 1e6:.0f} um"
            ),
        )
