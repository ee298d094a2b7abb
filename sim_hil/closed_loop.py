"""Rig and device in one process on a simulated clock: the same stages, the same wiring and the same
encoded frames.

Deterministic and faster than real time; tests, replay and training live on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from firmware_py.device import BrainStage, Device, GuardStage, Listener
from firmware_py.records import Decision, PlannedRamp, RawFrame
from firmware_py.routing import GUARD_PERIOD_NS

__all__ = ["ClosedLoop", "Listener", "RigStage"]


class RigStage(Protocol):
    """What the loop needs of the rig."""

    def step(self, now_ns: int, frames_in: list[RawFrame]) -> list[RawFrame]:
        """Advance to ``now_ns``; all frames due until then."""


class ClosedLoop:
    """The whole device against the rig.

    Parameters
    ----------
    rig
        Its clock starts where ``now_ns`` stands.
    guard, make_brain, listeners
        See :class:`firmware_py.device.Device`.

    Attributes
    ----------
    frames_in, frames_out
        What the device received and sent in the newest cycle.
    """

    def __init__(
        self,
        rig: RigStage,
        guard: GuardStage,
        make_brain: Callable[[], BrainStage] | None,
        listeners: Iterable[Listener] = (),
        now_ns: int = GUARD_PERIOD_NS,
    ) -> None:
        self.device = Device(guard, make_brain, listeners)
        self.now_ns = now_ns
        self.frames_in: list[RawFrame] = []
        self.frames_out: list[RawFrame] = []
        self._rig = rig

    @property
    def brain_runs(self) -> bool:
        """Whether a brain is connected."""
        return self.device.brain_runs

    def kill_brain(self) -> None:
        """See :meth:`firmware_py.device.Device.kill_brain`."""
        self.device.kill_brain()

    def start_brain(self) -> None:
        """See :meth:`firmware_py.device.Device.start_brain`."""
        self.device.start_brain()

    def command(
        self,
        verb: str,
        value: float | None = None,
        mode: int | None = None,
        *,
        ramp: PlannedRamp | None = None,
        action: str = "",
        target: str = "",
        owner: str = "",
        reason: str = "",
    ) -> int:
        """See :meth:`firmware_py.device.Device.command`."""
        return self.device.command(
            verb, value, mode, ramp=ramp, action=action, target=target, owner=owner, reason=reason
        )

    def step(self) -> Decision:
        """One cycle of the guard: rig, guard, brain, in the order of the wires."""
        self.now_ns += GUARD_PERIOD_NS
        self.frames_in = self._rig.step(self.now_ns, self.frames_out)
        decision = self.device.step(self.now_ns, self.frames_in)
        self.frames_out = decision.frames_out
        return decision
