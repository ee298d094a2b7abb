"""Collects what the device said and what was true, each with its time in the story."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from firmware_py.records import (
    Advice,
    CycleRecord,
    Diagnosis,
    Event,
    Forecast,
    GuardState,
    PeerRecord,
    RigReading,
)
from sim_hil.demo.story import Beat
from sim_hil.plant.truth import RigTruth


@dataclass(frozen=True)
class StoryTruth:
    """What the rig in software knows of itself over one tenth of a second."""

    t_s: float
    speed_rad_s: float
    load_N: float
    clearance_um: float
    power_W: float
    min_film_um: float
    peak_to_peak_um: float
    viscosity_Pa_s: float

    @classmethod
    def of(cls, record: RigTruth, t_s: float) -> StoryTruth:
        """The rig's entry at ``t_s`` of the story."""
        return cls(
            t_s,
            record.speed_rad_s,
            record.load_N,
            record.clearance_um,
            record.power_W,
            record.min_film_um,
            record.peak_to_peak_um,
            record.viscosity_Pa_s,
        )


@dataclass
class StoryObserver:
    """A listener: keeps diagnoses, forecasts, states, events and the truth.

    ``started_ns`` is the host time at which the story began.
    """

    started_ns: int
    diagnoses: list[tuple[float, Diagnosis]] = field(default_factory=list)
    forecasts: list[tuple[float, Forecast]] = field(default_factory=list)
    states: list[tuple[float, GuardState]] = field(default_factory=list)
    readings: list[tuple[float, RigReading]] = field(default_factory=list)
    events: list[tuple[float, Event]] = field(default_factory=list)
    truth: list[StoryTruth] = field(default_factory=list)
    beats: list[tuple[float, Beat]] = field(default_factory=list)
    advice: Advice | None = None
    seen: Counter[str] = field(default_factory=Counter)

    def story_s(self, now_ns: int) -> float:
        """Seconds since the story began."""
        return (now_ns - self.started_ns) * 1e-9

    def on_record(self, record: PeerRecord, now_ns: int) -> None:
        """Take in one record that crossed a room's border."""
        if isinstance(record, CycleRecord):
            return
        t_s = self.story_s(now_ns)
        self.seen[type(record).__name__] += 1
        match record:
            case Diagnosis():
                self.diagnoses.append((t_s, record))
            case Forecast():
                self.forecasts.append((t_s, record))
            case GuardState():
                self.states.append((t_s, record))
            case RigReading():
                self.readings.append((t_s, record))
            case Event():
                self.events.append((t_s, record))
            case Advice():
                self.advice = record

    def on_beat(self, beat: Beat, now_ns: int) -> None:
        """Something was done to the rig or to the device."""
        self.beats.append((self.story_s(now_ns), beat))

    @property
    def state(self) -> GuardState | None:
        """The guard's latest word on itself."""
        return self.states[-1][1] if self.states else None

    @property
    def diagnosis(self) -> Diagnosis | None:
        """The latest diagnosis."""
        return self.diagnoses[-1][1] if self.diagnoses else None

    @property
    def forecast(self) -> Forecast | None:
        """The latest forecast."""
        return self.forecasts[-1][1] if self.forecasts else None
