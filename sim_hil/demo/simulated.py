"""The demo on a simulated clock: every stage in one process, deterministic, faster than real
time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from firmware_py.brain.core import BrainCore
from firmware_py.brain.store import load_models
from firmware_py.guard.core import GuardCore
from firmware_py.records import Mode, RawFrame, SampleFrame
from firmware_py.wire.link import Codec, codec_for
from sim_hil.closed_loop import ClosedLoop, Listener
from sim_hil.demo.live import Quiet, beat_text
from sim_hil.demo.observer import StoryObserver, StoryTruth
from sim_hil.demo.setting import Setting
from sim_hil.demo.story import Beat, Story
from sim_hil.hil.rig import Rig, node_limits

BRAIN_AWAY_S = 3.0
"""How long a killed brain stays away."""

START_NS = 1_000_000_000
"""Where the simulated clock starts."""

SESSION = 0x5EED0001
"""Nonce of the simulated guard: fixed, so that runs repeat bit for bit."""


@dataclass
class SimulatedRun:
    """What a run on the simulated clock leaves behind."""

    observer: StoryObserver
    counters: dict[str, int]
    frames_expected: int
    brain_back_s: float | None


class Player:
    """Plays a story through a :class:`ClosedLoop`."""

    def __init__(
        self,
        setting: Setting,
        story: Story,
        screen: Quiet,
        observer: StoryObserver,
        listeners: tuple[Listener, ...] = (),
    ) -> None:
        self._story, self._screen, self._observer = story, screen, observer
        codec = codec_for(setting.config)
        self.rig = Rig(
            setting.rig,
            codec,
            node_limits(setting.rig, setting.config),
            story.seed,
            build=setting.build,
            rate_hz=setting.config.sampling.rate_hz,
        )
        self.guard = GuardCore(setting.config, codec, SESSION)
        models = load_models(setting.config)
        self.loop = ClosedLoop(
            self.rig,
            self.guard,
            lambda: BrainCore(setting.config, models),
            (observer.on_record, *listeners),
            now_ns=observer.started_ns,
        )
        self._counter = _SampleCounter(codec)
        self._truth_ns = 0
        self._killed_ns: int | None = None
        self._brain_back_s: float | None = None

    def play(self) -> SimulatedRun:
        """Step through the whole story."""
        beats = list(self._story.beats)
        end_ns = self._observer.started_ns + round(self._story.seconds * 1e9)
        with self._screen:
            while self.loop.now_ns < end_ns:
                t_s = self._observer.story_s(self.loop.now_ns)
                while beats and beats[0].t_s <= t_s:
                    self._perform(beats.pop(0))
                self._revive_brain()
                self.loop.step()
                self._counter.count(self.loop.frames_in)
                self._read_truth()
                self._screen.update(t_s)
        return SimulatedRun(
            self._observer, self.guard.counters, self._counter.frames, self._brain_back_s
        )

    def _perform(self, beat: Beat) -> None:
        self._observer.on_beat(beat, self.loop.now_ns)
        self._screen.say(f"{beat.t_s:6.1f} s     {beat_text(beat)}")
        perform_on_rig(self.rig, beat)
        if beat.verb == "arm":
            self.loop.command("mode", mode=Mode.AUTO)
            self.loop.command("arm")
        elif beat.verb == "kill_brain":
            self.loop.kill_brain()
            self._killed_ns = self.loop.now_ns

    def _revive_brain(self) -> None:
        if self._killed_ns is not None and self.loop.now_ns - self._killed_ns >= BRAIN_AWAY_S * 1e9:
            self.loop.start_brain()
            self._brain_back_s = (self.loop.now_ns - self._killed_ns) * 1e-9
            self._killed_ns = None
            self._screen.say("           the brain is back and starts anew")

    def _read_truth(self) -> None:
        for record in reversed(self.rig.truth):
            if record.t_ns <= self._truth_ns:
                break
            self._observer.truth.append(StoryTruth.of(record, self._observer.story_s(record.t_ns)))
        if self.rig.truth:
            self._truth_ns = self.rig.truth[-1].t_ns


class _SampleCounter:
    """Counts the sample frames that the rig put on the wire."""

    def __init__(self, codec: Codec) -> None:
        self._decode: Callable[[RawFrame], object] = codec.decode
        self._ids: dict[int, bool] = {}
        self.frames = 0

    def count(self, frames: list[RawFrame]) -> None:
        """Add the sample frames among ``frames``."""
        for frame in frames:
            if frame.frame_id not in self._ids:
                self._ids[frame.frame_id] = isinstance(self._decode(frame), SampleFrame)
            self.frames += self._ids[frame.frame_id]


def perform_on_rig(rig: Rig, beat: Beat) -> None:
    """What a beat does to the rig itself."""
    if beat.verb == "operating":
        rig.set_operating(beat.speed_rpm, beat.load_N, beat.ramp_s)
    elif beat.verb == "inject":
        rig.inject(beat.fault, beat.severity)
    elif beat.verb == "clear":
        rig.clear()
