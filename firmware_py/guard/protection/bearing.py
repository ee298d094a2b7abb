"""The further bearings of a machine: limits, channel OK and plausibility of their own probes.

Each is judged by the stages of the first bearing, with the configuration of a machine that has it
alone (:mod:`firmware_py.config.bearings`).  Their alarms go by the names of their channels
(``NAME_danger``), that of the pair by the bearing's (``BEARING_pair_KIND``).
"""

from __future__ import annotations

import msgspec

from firmware_py.config.bearings import BearingView
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.guard.plausibility.pair import PairCheck
from firmware_py.guard.plausibility.pair_window import PairState
from firmware_py.guard.protection.vibration import Protection, ProtectionState
from firmware_py.machine.parts import CLEARANCE, has
from firmware_py.records import Alarm, Block


class BearingGuardState(msgspec.Struct):
    """What the stages of one bearing remember (for snapshots)."""

    protection: ProtectionState
    pair: PairState


class BearingGuard:
    """Protection of one further bearing.

    Parameters
    ----------
    view
        The bearing, and the configuration of a machine that has it alone.
    latched
        Names of danger alarms that stood latched when the guard last ended; those of others are
        left alone.
    """

    def __init__(self, view: BearingView, latched: list[str]) -> None:
        self._view, self.name = view, view.name
        machine = view.config.machine
        dangers = {f"{channel.name}_danger" for channel in machine.channel}
        self._protection = Protection(view.config, [n for n in latched if n in dangers])
        self._pair = PairCheck(view.config, view.name)
        nominal_um = machine.bearing.radial_clearance_nominal_um
        self.cap_um = nominal_um if has(machine, CLEARANCE) else float("inf")

    @property
    def state(self) -> BearingGuardState:
        """The memory of its stages."""
        return BearingGuardState(self._protection.state, self._pair.state)

    def restore(self, state: BearingGuardState) -> None:
        """Go on from a snapshot."""
        self._protection.state = state.protection
        self._pair.restore(state.pair)

    def step(self, blocks: list[Block], oil_C: float | None) -> list[Notice]:
        """Judge its channels of new blocks; ``oil_C`` is None where the outlet is not known."""
        own, notices = [self._view.block(block) for block in blocks], list[Notice]()
        notices += self._protection.step(own, self.cap_um)
        facts = self._pair.drawn(oil_C)
        for block in own:
            notices += self._pair.step(block, facts, max(self.peak_to_peak_um) * 1e-6)
        return notices

    # ------------------------------------------------------------------ what stands now

    @property
    def peak_to_peak_um(self) -> tuple[float, float]:
        """Vibration over the last full turn, of its two probes."""
        return self._protection.motion.peak_to_peak_um

    @property
    def alarms(self) -> list[str]:
        """Names of all its limits."""
        return list(self._protection.state.alarms)

    @property
    def causes(self) -> dict[str, str]:
        """Why each of its channels that is not OK is not."""
        return self._protection.causes

    @property
    def protection(self) -> Protection:
        """Its limits and channels."""
        return self._protection

    def standing(self) -> list[Alarm]:
        """Every alarm that stands now."""
        return [*self._protection.standing(), *self._pair.standing()]

    def reset(self) -> list[str]:
        """Clear the latches; the reasons why some stay."""
        return self._protection.reset()
