"""Authority: may the model act?  Lost at any doubt, regained slowly, and not for ever (design,
States)."""

from __future__ import annotations

from math import isfinite
from typing import Final

import msgspec

from firmware_py.config import AuthorityConfig
from firmware_py.guard.alarms.alarm import Notice
from firmware_py.records import Advice, Severity

CHANGED: Final = "(changed)"
"""In place of the sets that stood when the device was armed, once others have come: no set is
called so."""

HOUR_NS: Final = 3_600_000_000_000

AHEAD_MAX_NS: Final = 50_000_000
"""An advice may be stamped this much later than now: the guard reads its clock before its inputs,
and may be held up between the two.  It lengthens the life of an advice by as much, at most."""


def is_ahead(advice: Advice, now_ns: int) -> bool:
    """Whether a stamp of ``advice`` lies further in the future than it may."""
    return max(advice.t_ns, advice.t_acq_ns) > now_ns + AHEAD_MAX_NS


class AuthorityState(msgspec.Struct):
    """Whether the model acts, how far it is on the way back, and how often it came back."""

    held: bool = False
    good: int = 0
    last_seq: int = -1
    doubt_ns: int = 0
    regain: bool = False
    regains_ns: list[int] = []
    exhausted: bool = False
    reasons: list[str] = []
    lost_ns: int = 0
    models: str = ""
    """Sets of models that the advice rested on when the device was armed."""


class Authority:
    """Gives authority after ``good_advices`` in a row and ``regain_after_s`` without doubt.

    Parameters
    ----------
    config
        Table ``[authority]``.
    """

    def __init__(self, config: AuthorityConfig) -> None:
        self._config = config
        self._age_max_ns = round(config.advice_age_max_ms * 1e6)
        self._after_ns = round(config.regain_after_s * 1e9)
        self.state = AuthorityState()

    def advice_reasons(self, advice: Advice | None, connected: bool, now_ns: int) -> list[str]:
        """Every reason why ``advice`` cannot be acted on; empty when it can."""
        if not connected:
            return ["the brain is not connected"]
        if advice is None:
            return ["the brain has given no advice yet"]
        reasons = list(advice.reasons)
        if advice.clearance_um is None:
            reasons.append("the brain proposes nothing")
        elif not isfinite(advice.clearance_um) or not isfinite(advice.pressure_bar or 0.0):
            reasons.append("the advice is not finite")
        if is_ahead(advice, now_ns):
            ahead_ns = max(advice.t_ns, advice.t_acq_ns) - now_ns
            reasons.append(
                f"the advice is stamped {ahead_ns * 1e-6:.0f} ms later than now (limit "
                f"{AHEAD_MAX_NS * 1e-6:.0f}): the brain's clock is not this one; restart the brain"
            )
        elif now_ns - advice.t_ns > min(advice.lifetime_ns, self._age_max_ns):
            reasons.append("the advice has expired")
        elif now_ns - advice.t_acq_ns > self._age_max_ns:
            reasons.append("the advice rests on old samples")
        if not advice.qualified and not self._config.provisional_may_act:
            reasons.append("the model is provisional and authority.provisional_may_act is false")
        return reasons

    def step(self, reasons: list[str], seq: int, now_ns: int) -> list[Notice]:
        """Judge one cycle: ``reasons`` against acting (empty = none), ``seq`` of the present
        advice."""
        s = self.state
        if reasons:
            return self._lose(reasons, now_ns)
        if seq != s.last_seq:
            s.last_seq = seq
            s.good += 1
        if s.held:
            return []
        s.reasons = self._waiting(now_ns)
        return [] if s.reasons else self._gain(now_ns)

    def reset(self) -> None:
        """A person has looked: the count of regains starts anew."""
        self.state.exhausted = False
        self.state.regains_ns = []

    def know(self, advice: Advice | None) -> list[str]:
        """Why an armed device does not follow ``advice``: it rests on other models than the person
        has armed for.  Once seen, that stands until :meth:`start`."""
        s = self.state
        if advice is not None and advice.models != s.models:
            s.models = CHANGED
        if s.models != CHANGED:
            return []
        return ["the models have changed since the device was armed; look, then `orbitd arm`"]

    def start(self, now_ns: int, models: str) -> None:
        """The device has just been armed: authority begins from nothing, and not as a regain."""
        s = self.state
        s.models = models
        s.held, s.good, s.regain, s.doubt_ns = False, 0, False, now_ns

    def _lose(self, reasons: list[str], now_ns: int) -> list[Notice]:
        s = self.state
        s.good, s.doubt_ns, s.reasons = 0, now_ns, reasons
        if not s.held:
            return []
        s.held, s.regain, s.lost_ns = False, True, now_ns
        return [Notice(Severity.ALERT, "authority_lost", "; ".join(reasons))]

    def _waiting(self, now_ns: int) -> list[str]:
        """What is still missing when nothing speaks against acting."""
        s, c = self.state, self._config
        reasons = []
        if s.exhausted:
            reasons.append(
                f"authority came back {c.max_regains_per_hour} times within an hour; `reset` after "
                f"a look"
            )
        if s.good < c.good_advices:
            reasons.append(f"{s.good} of {c.good_advices} good advices in a row")
        if now_ns - s.doubt_ns < self._after_ns:
            reasons.append(f"last doubt less than {c.regain_after_s:g} s ago")
        return reasons

    def _gain(self, now_ns: int) -> list[Notice]:
        s = self.state
        s.regains_ns = [t for t in s.regains_ns if now_ns - t < HOUR_NS]
        if s.regain and len(s.regains_ns) >= self._config.max_regains_per_hour:
            s.exhausted = True
            return [Notice(Severity.ALERT, "authority_exhausted", self._waiting(now_ns)[0])]
        if s.regain:
            s.regains_ns.append(now_ns)
        s.held = True
        return [Notice(Severity.INFO, "authority_gained", f"after {s.good} good advices")]
