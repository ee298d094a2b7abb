"""The tables of ``machine.toml`` for its sensors: fast channels and slow readings.

The text at each key is also the remark that ``orbitd rig new`` writes above it.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from firmware_py.machine.values import (
    AngleDeg,
    AnySI,
    DbcFile,
    Label,
    MachineTable,
    OptionalWord,
    PressureBar,
    ReadingValue,
    Share,
    SignalName,
    Word,
)


class FastChannel(MachineTable, frozen=True):
    """One sensor channel: SI = ``counts * scale + offset``; outside ``ok_low .. ok_high`` it is not
    OK."""

    name: Word
    """Name of the channel; the two displacement probes, disp_x and disp_y, come first."""
    unit: Word
    """SI unit of its values, that of its kind."""
    scale: Annotated[float, Meta(ge=-1.0, le=1.0)]
    """SI per count as calibrated; negative where the sensor's sign is the other. From: a
    calibration; of a probe a micrometer on the target."""
    ok_low: AnySI
    """Below this value, SI, the channel is not OK. From: the sensor's linear range."""
    ok_high: AnySI
    """Above this value, SI, the channel is not OK. From: the sensor's linear range."""
    offset: AnySI = 0.0
    """Value at no counts, SI. From: a calibration; of a probe the shaft at rest on the bottom of
    the bearing."""
    angle_deg: AngleDeg = 0.0
    """Direction in which a probe looks, from x (right) towards y (up), seen so that the shaft turns
    the same way. From: the drawing."""
    slow_roll_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Runout: amplitude of the first order at slow roll; the predictor takes it off. From: a slow
    roll, far below the first critical speed."""
    slow_roll_deg: AngleDeg = 0.0
    """Its phase: the argument of the complex amplitude counted from the mark. From: the same slow
    roll."""
    zeroed: bool = False
    """Whether the zero and slow-roll procedure was done: the smaller errors after it hold. From:
    your protocol."""
    zeroed_zero_error: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    """Error of zero that the procedure leaves, SI; not given: 0.5e-6, as of the three below the
    typical eddy-current probe. From: repeated zeroing."""
    zeroed_gain_error_share: Share | None = None
    """Error of gain that a calibration on this very target leaves. From: a micrometer on the
    target, 1 %."""
    zeroed_runout_m: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    """Runout, amplitude of one order, beside the slow-roll vector. From: repeated slow rolls."""
    runout_m: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    """Greatest runout of a probe in one order, amplitude, before the procedure. From: a slow roll,
    or a dial and 6e-6."""
    kind: OptionalWord = ""
    """What the channel measures, a row of `docs/signals.md`; empty: that of the standard channel of
    this name."""
    bearing: OptionalWord = ""
    """Name of the bearing at which it sits; empty: the first."""
    wire_scale: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """SI per count as the node sends it, before calibration; 0: that of the kind."""
    words: Label = ""
    """For people; empty: those of the standard channel or of the kind."""
    range_low: AnySI | None = None
    """Least value that the sensor can show, SI. From: its data sheet."""
    range_high: AnySI | None = None
    """Greatest value that the sensor can show, SI. From: its data sheet."""
    noise_rms: Annotated[float, Meta(ge=0.0, le=1e5)] | None = None
    """Noise of a sample, SI. From: readings at rest."""
    bandwidth_hz: Annotated[float, Meta(ge=0.1, le=1e6)] | None = None
    """Where the sensor with its amplifier falls by 3 dB. From: its data sheet."""
    gain_error_share: Share | None = None
    """Error of the scale as the sensor is built. From: its data sheet; a probe on another steel
    than the calibrated one, 3 %."""
    zero_error: Annotated[float, Meta(ge=0.0, le=1e5)] | None = None
    """Error of zero as the sensor is built, SI. From: its data sheet; a probe set with feeler
    gauges, 2e-6."""


class SlowChannel(MachineTable, frozen=True):
    """One slow reading of the rig; outside ``ok_low .. ok_high`` it is not OK."""

    name: Word
    """Name of the reading."""
    kind: OptionalWord = ""
    """What it measures, a row of `docs/signals.md`; empty: that of the standard reading of this
    name."""
    ok_low: ReadingValue = -1e9
    """Below this value the reading is not OK, in the unit of its kind. From: the sensor's range."""
    ok_high: ReadingValue = 1e9
    """Above this value the reading is not OK. From: the sensor's range."""
    words: Label = ""
    """For people; empty: those of the standard reading or of the kind."""


class SlowReadings(MachineTable, frozen=True):
    """What the slow readings of RIG_STATUS can be; one that is not so is not OK, and nothing rests
    on it."""

    age_max_ms: Annotated[float, Meta(ge=100, le=2000)] = 250.0
    """Older readings say nothing; a rig sends them every 50 ms. From: the node."""
    clean_s: Annotated[float, Meta(ge=0, le=600)] = 10.0
    """A reading that was not OK is believed again after it has been plausible for so long. From: a
    choice."""
    oil_outlet_min_C: Annotated[float, Meta(ge=-100, le=200)] = -20.0
    """Least temperature that the outlet thermometer shows. From: its data sheet."""
    oil_outlet_max_C: Annotated[float, Meta(ge=-100, le=300)] = 150.0
    """Greatest temperature that it shows. From: its data sheet."""
    oil_outlet_rate_C_s: Annotated[float, Meta(ge=0.01, le=1000)] = 20.0
    """Faster changes are those of a cable: the oil behind the thermometer has to be warmed. From:
    the greatest power over the oil's heat capacity."""
    shaft_power_max_W: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """Greatest credible shaft power; 0: ten times the friction of the narrowest bearing in the
    thickest oil at the top speed. From: the drive."""
    pressure_max_bar: PressureBar = 0.0
    """Greatest credible supply pressure; 0: twice `feed.pressure_max_bar`. From: the supply."""
    pressure_mismatch_bar: Annotated[float, Meta(ge=0.01, le=10)] = 0.3
    """The reading and the channel `supply_pressure` may differ by so much. From: the errors of both
    gauges."""
    oil_outlet_error_C: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0
    """Error of the thermometer in the outlet. From: its class; a Pt100 with its cable reaches 1
    K."""
    oil_outlet_scatter_C: Annotated[float, Meta(ge=0.0, le=50.0)] = 2.0
    """Two readings of one temperature may differ by so much: its step, and pick-up. From: readings
    at rest."""
    clearance_scatter_um: Annotated[float, Meta(ge=0.05, le=100.0)] = 3.0
    """Two readings of a clearance at rest may differ by so much: noise, backlash, an end stop that
    gives. From: readings at rest."""


class ForeignBus(MachineTable, frozen=True):
    """A bus that knows nothing of orbitd: its signals are mapped, nothing is ever sent there."""

    dbc: DbcFile
    """Name of the DBC in the rig folder. From: the maker of whoever sends."""


class MappedSignal(MachineTable, frozen=True):
    """A signal of a foreign bus, and which channel or reading it is."""

    signal: SignalName
    """Message and signal of the DBC. From: the DBC."""
    to: Word
    """Name of the channel or reading; or `mark` (not 0 while the mark passes), `turns` (count of
    marks), `mark_age` (time since the newest mark), `counter` (of its message, +1 each). From: what
    the signal is."""
    instant: Annotated[int, Meta(ge=0, le=23)] = 0
    """Of a message that carries several samples of a channel, which of them, 0 the oldest. From:
    the DBC."""
    polarity: Literal[-1, 1] = 1
    """-1 where the sensor's sign is the other. From: a push at the sensor."""
    every_ms: Annotated[int, Meta(ge=1, le=5000)] = 100
    """Time between two values of a slow reading; what is not older counts as new. From: the DBC, or
    a listener on the bus."""
    unit: Label = ""
    """Unit of the signal; empty: that of the DBC. From: the DBC's comment."""
