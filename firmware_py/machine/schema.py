"""The tables of ``machine.toml``: typed, a unit in every name, one place for each figure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import msgspec
from msgspec import Meta

from firmware_py.machine.values import (
    AngleDeg,
    AnySI,
    BearingMassKg,
    ClearanceUm,
    Label,
    LoadN,
    MachineTable,
    Name,
    OptionalWord,
    PressureBar,
    ReadingValue,
    Section,
    Share,
    SpeedRpm,
    TemperatureC,
    Word,
)


class JournalBearing(MachineTable, frozen=True):
    """The journal bearing; every clearance says radial or diametral."""

    journal_radius_m: Annotated[float, Meta(ge=0.001, le=0.5)]
    """Watch-sized shafts to the largest turbines."""
    length_m: Annotated[float, Meta(ge=0.001, le=1.0)]
    radial_clearance_min_um: ClearanceUm
    radial_clearance_max_um: ClearanceUm
    radial_clearance_nominal_um: ClearanceUm
    radial_clearance_offset_um: Annotated[float, Meta(ge=-100.0, le=100.0)] = 0.0
    """This bearing is so much wider than the actuator tells: from a lift check."""
    radial_clearance_error_um: Annotated[float, Meta(ge=0.05, le=50.0)] = 2.0
    """And is known within this."""
    load_error_share: Share = 0.21
    """The film carries this much less or more than the unfed Reynolds film there: rupture, inlet,
    unknown groove."""
    attitude_error_deg: Annotated[float, Meta(ge=0, le=45)] = 15.0
    """And stands this much off in direction."""
    friction_error_share: Annotated[float, Meta(ge=0, le=1)] = 1.0
    """And has this much less or more friction; 1: the shaft power says nothing about the oil."""
    cone_half_angle_deg: Annotated[float, Meta(ge=0.1, le=60.0)] | None = None
    """Of a conical bearing, whose axial shift sets the clearance."""
    name: OptionalWord = ""
    """By which channels say where they sit; of the first bearing it may stay empty."""


class OtherBearing(JournalBearing, frozen=True):
    """A further bearing, which is watched and never controlled."""

    load_min_N: LoadN | None = None
    load_max_N: LoadN | None = None
    """Its static load; not given: its probes are not held against the film at rest."""


class Lubricant(MachineTable, frozen=True):
    """Viscosity, ``mu = mu_40 exp(-k (T - 40))`` (:mod:`~firmware_py.machine.lubricant`), and the
    inlet range that the safe value must cover."""

    viscosity_at_40C_Pa_s: Annotated[float, Meta(ge=2e-4, le=1.5)]
    """Thinner than petrol up to ISO VG 1500."""
    viscosity_slope_per_K: Annotated[float, Meta(ge=0.0, le=0.1)]
    """Water 0.02, oils 0.02 .. 0.06."""
    inlet_min_C: TemperatureC
    inlet_max_C: TemperatureC
    film_max_C: TemperatureC
    viscosity_error_share: Share = 0.1
    """A batch of oil is this much thinner or thicker than the law."""
    film_at_outlet: bool = False
    """The film is as warm as its outlet; else it may be as cold as the coldest inlet."""
    thermal_capacity_J_K: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """Of the oil node behind the outlet thermometer; 0: forecasts hold the oil's temperature."""
    cooling_W_K: Annotated[float, Meta(ge=0.0, le=1e5)] = 0.0
    """Heat that the oil carries away per kelvin above its inlet."""
    density_kg_m3: Annotated[float, Meta(ge=100.0, le=3000.0)] = 870.0
    heat_capacity_J_kgK: Annotated[float, Meta(ge=500.0, le=10_000.0)] = 2000.0
    """Of a mineral oil; water has 998 and 4180."""


class Feed(MachineTable, frozen=True):
    """Oil supply pressure above ambient: what the actuator may set."""

    pressure_min_bar: PressureBar
    pressure_max_bar: PressureBar
    groove_area_min_mm2: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    groove_area_max_mm2: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """A groove opposite the load presses the shaft down like a piston of an area between these two;
    0: no groove."""
    pressure_nominal_bar: PressureBar | None = None
    groove_angle_deg: AngleDeg | None = None
    """Middle of one axial groove, counted as the channels' angles are; 90 is opposite the load."""
    groove_width_deg: Annotated[float, Meta(ge=0.5, le=180.0)] | None = None
    groove_length_share: Annotated[float, Meta(ge=0.01, le=1.0)] | None = None
    """Of the bearing's length."""
    full_film_bar: PressureBar | None = None
    """Below it the film is not full; None: half of the least pressure.  The danger limit of the
    pressure follows from it."""
    pump_shut_off_bar: Annotated[float, Meta(ge=0.01, le=1000.0)] | None = None
    """What the pump, or its relief valve, gives at no flow; it falls evenly to nothing at
    ``pump_flow_max_m3_s``.  None: any pressure at any flow."""
    pump_flow_max_m3_s: Annotated[float, Meta(ge=1e-9, le=10.0)] | None = None
    hold_up_s: Annotated[float, Meta(ge=0.0, le=3600.0)] = 0.0
    """Time constant with which the pressure falls after the loss of the pump (accumulator and check
    valve); 0: none, it falls as fast as it follows its target."""
    pump_error_share: Share = 0.1
    """The pump gives, and the hold-up lasts, at most this much less than that."""
    pump_efficiency: Annotated[float, Meta(ge=0.05, le=1.0)] = 0.6
    jacket_flow_m3_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """Forced flow around the film, which takes its heat away."""


class RotorDrawing(MachineTable, frozen=True):
    """A rigid rotor between a coupling and the bearing; distances are from its centre of gravity.

    Either its drawing (mass, diametral inertia, both distances) or its effective mass at the
    bearing is given.
    """

    unbalance_normal_kg_m: Annotated[float, Meta(ge=0.0, le=100.0)]
    mass_error_share: Share = 0.05
    """The built rotor is heavier than that by at most this share."""
    unbalance_measured: bool = False
    """The normal unbalance is this rotor's own, from balancing; else it is the most that its grade
    lets any have."""
    whirl_error_share: Share = 0.05
    """The speed at which it whirls lies at most this much below that of a rigid rotor on the film:
    coupling, pedestal, gyroscopic moments."""
    shaft_power_error_W: Annotated[float, Meta(ge=0.01, le=1e6)] = 5.0
    """Of the shaft power that the rig reports; less where its zero was taken at rest."""
    windage_W_s3: Annotated[float, Meta(ge=0.0, le=1e-3)] = 0.0
    """Shaft power beside the film's, per cubed speed (rad/s): from a coast-down."""
    effective_mass_at_bearing_kg: BearingMassKg | None = None
    """Force over acceleration at the bearing, of a rotor that was weighed: that in forward whirl
    (inertia ``J_d - J_p / 0.515``); it counts before that of the drawing."""
    mass_kg: Annotated[float, Meta(ge=0.001, le=1e6)] | None = None
    diametral_inertia_kg_m2: Annotated[float, Meta(ge=1e-9, le=1e9)] | None = None
    polar_inertia_kg_m2: Annotated[float, Meta(ge=1e-9, le=1e9)] | None = None
    coupling_to_cg_m: Annotated[float, Meta(ge=0.001, le=100.0)] | None = None
    bearing_to_cg_m: Annotated[float, Meta(ge=0.0, le=100.0)] | None = None
    coupling_stiffness_N_m: Annotated[float, Meta(ge=1.0, le=1e13)] | None = None
    coupling_damping_N_s_m: Annotated[float, Meta(ge=0.0, le=1e9)] | None = None

    @property
    def drawn_mass_at_bearing_kg(self) -> float | None:
        """Mass felt at the bearing when the rotor swings about its coupling end; None where the
        drawing is not given."""
        mass, inertia = self.mass_kg, self.diametral_inertia_kg_m2
        to_coupling, to_bearing = self.coupling_to_cg_m, self.bearing_to_cg_m
        if mass is None or inertia is None or to_coupling is None or to_bearing is None:
            return None
        length = to_coupling + to_bearing
        return (inertia + mass * (to_coupling * to_coupling)) / (length * length)

    @property
    def mass_at_bearing_kg(self) -> float:
        """The effective mass that counts: weighed, else that of the drawing.

        Raises
        ------
        ValueError
            Neither is given, which a verified configuration never is.
        """
        found = self.effective_mass_at_bearing_kg or self.drawn_mass_at_bearing_kg
        if found is None:
            raise ValueError("rotor: neither weighed nor drawn; load the rig folder verified")
        return found


class ContactCircuit(MachineTable, frozen=True):
    """The contact-resistance channel: a film resistance proportional to the smallest film, behind a
    series resistor."""

    circuit_V: Annotated[float, Meta(ge=0.01, le=3.2)]
    """The wire carries up to 3.2767 V."""
    circuit_ohm: Annotated[float, Meta(ge=1.0, le=1e9)]
    film_ohm_per_m: Annotated[float, Meta(ge=1e3, le=1e15)]
    film_error_share: Annotated[float, Meta(ge=1e-3, le=1.0)]
    """Standard deviation of ``film_ohm_per_m`` as a share of it."""


class OperatingRange(MachineTable, frozen=True):
    """The declared range: protection, shield and the safe value answer for all of it."""

    speed_min_rpm: SpeedRpm
    speed_max_rpm: SpeedRpm
    load_min_N: LoadN
    load_max_N: LoadN
    speed_ramp_max_rpm_s: Annotated[float, Meta(ge=1.0, le=1e5)]
    speed_ramp_unannounced_rpm_s: Annotated[float, Meta(ge=1.0, le=1e5)]
    """Faster ramps of speed or load are announced before they start (command ``announce``)."""
    load_ramp_unannounced_N_s: Annotated[float, Meta(ge=0.01, le=1e6)]


class ClearanceActuator(MachineTable, frozen=True):
    """The node's promises; ``safe`` must equal what the node boots with."""

    safe_radial_clearance_um: ClearanceUm
    safe_pressure_bar: PressureBar
    rate_um_s: Annotated[float, Meta(ge=1.0, le=6500.0)]
    """The wire carries up to 6553.5 um/s."""
    time_constant_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.05
    time_to_live_ms: Annotated[int, Meta(ge=10, le=1000)] = 100
    command_period_ms: Annotated[int, Meta(ge=1, le=100)] = 20
    pressure_dead_time_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    """The supply pressure does not move for so long after its target has."""
    pressure_time_constant_s: Annotated[float, Meta(ge=0.01, le=60)] = 1.0
    """And then follows with this lag: three of them pass before an error counts."""
    pressure_slew_bar_s: Annotated[float, Meta(ge=0.01, le=1e4)] | None = None
    """And no faster than this; None: as fast as the lag lets it."""
    pressure_error_share: Share = 0.0
    """Dead time and lag are at most this much longer, and the slew this much slower, than that."""
    following_error_um: Annotated[float, Meta(ge=0.1, le=1000)] = 5.0
    """The measured clearance may lie this far beyond where an actuator of the declared rate can
    be."""
    following_error_bar: Annotated[float, Meta(ge=0.01, le=100)] = 0.3
    """And the measured supply pressure."""
    following_time_s: Annotated[float, Meta(ge=0.5, le=30)] = 2.0
    """For this long, before it is an alarm; gross errors and slow movement are one sooner."""
    reversals_per_minute_max: Annotated[int, Meta(ge=2, le=6000)] = 300
    """The target may turn back this often within a minute; then authority goes, and a set point
    holds."""
    backlash_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    position_noise_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.2
    """Deviation (rms) of the measured clearance."""


class FastChannel(MachineTable, frozen=True):
    """One sensor channel: SI = ``counts * scale + offset``; outside ``ok_low .. ok_high`` it is not
    OK."""

    name: Word
    unit: Word
    scale: Annotated[float, Meta(ge=-1.0, le=1.0)]
    ok_low: AnySI
    ok_high: AnySI
    offset: AnySI = 0.0
    angle_deg: AngleDeg = 0.0
    slow_roll_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Runout: amplitude of the first order at slow roll; the predictor takes it off."""
    slow_roll_deg: AngleDeg = 0.0
    """Its phase: the argument of the complex amplitude counted from the mark."""
    zeroed: bool = False
    """The zero and slow-roll procedure was done: the smaller errors after it hold."""
    zeroed_zero_error: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    zeroed_gain_error_share: Share | None = None
    zeroed_runout_m: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    """Of a displacement probe: zero, gain and amplitude of one order that it leaves.  None: those
    of :data:`firmware_py.machine.probes.TYPICAL`, as of the three below."""
    runout_m: Annotated[float, Meta(ge=0.0, le=1e-3)] | None = None
    """Greatest runout of a displacement probe in one order, amplitude, before the procedure."""
    kind: OptionalWord = ""
    """One of :data:`firmware_py.signals.FAST`; empty: that of the standard channel of this name."""
    bearing: OptionalWord = ""
    """Name of the bearing at which it sits; empty: the first."""
    wire_scale: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """SI per count as the node sends it, before calibration; 0: that of the kind."""
    words: Label = ""
    """For people; empty: those of the standard channel or of the kind."""
    range_low: AnySI | None = None
    range_high: AnySI | None = None
    """What the sensor can show, SI."""
    noise_rms: Annotated[float, Meta(ge=0.0, le=1e5)] | None = None
    bandwidth_hz: Annotated[float, Meta(ge=0.1, le=1e6)] | None = None
    gain_error_share: Share | None = None
    zero_error: Annotated[float, Meta(ge=0.0, le=1e5)] | None = None
    """Noise, bandwidth, and errors of gain and zero as it is built (SI); None: not known."""


class SlowChannel(MachineTable, frozen=True):
    """One slow reading of the rig; outside ``ok_low .. ok_high`` it is not OK."""

    name: Word
    kind: OptionalWord = ""
    """One of :data:`firmware_py.signals.SLOW`; empty: that of the standard reading of this name."""
    ok_low: ReadingValue = -1e9
    ok_high: ReadingValue = 1e9
    words: Label = ""
    """For people; empty: those of the standard reading or of the kind."""


class SlowReadings(MachineTable, frozen=True):
    """What the slow readings of RIG_STATUS can be; one that is not so is not OK, and nothing rests
    on it."""

    age_max_ms: Annotated[float, Meta(ge=100, le=2000)] = 250.0
    """Older ones say nothing; a rig sends them every 50 ms."""
    clean_s: Annotated[float, Meta(ge=0, le=600)] = 10.0
    """A reading that was not OK is believed again after it has been plausible for so long."""
    oil_outlet_min_C: Annotated[float, Meta(ge=-100, le=200)] = -20.0
    oil_outlet_max_C: Annotated[float, Meta(ge=-100, le=300)] = 150.0
    oil_outlet_rate_C_s: Annotated[float, Meta(ge=0.01, le=1000)] = 20.0
    """Faster changes are those of a cable: the oil behind the thermometer has to be warmed."""
    shaft_power_max_W: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """0: ten times the friction of the narrowest bearing in the thickest oil at the top speed."""
    pressure_max_bar: PressureBar = 0.0
    """0: twice ``feed.pressure_max_bar``."""
    pressure_mismatch_bar: Annotated[float, Meta(ge=0.01, le=10)] = 0.3
    """The reading and the channel ``supply_pressure`` may differ by so much."""
    oil_outlet_error_C: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.0
    """Error of the thermometer in the outlet."""
    oil_outlet_scatter_C: Annotated[float, Meta(ge=0.0, le=50.0)] = 2.0
    """Two readings of one temperature may differ by so much: its step, and pick-up."""
    clearance_scatter_um: Annotated[float, Meta(ge=0.05, le=100.0)] = 3.0
    """Two readings of a clearance at rest may differ by so much: noise, backlash, an end stop that
    gives."""


class Machine(Section, frozen=True):
    """One machine: all that is true of it, however the device runs there."""

    name: Name
    bearing: JournalBearing
    lubricant: Lubricant
    feed: Feed
    rotor: RotorDrawing
    operating: OperatingRange
    actuator: ClearanceActuator
    channel: list[FastChannel]
    reading: list[SlowChannel] = msgspec.field(default_factory=list)
    """Slow readings in wire order; empty: the standard ones."""
    readings: SlowReadings = SlowReadings()
    contact: ContactCircuit | None = None
    other_bearing: list[OtherBearing] = msgspec.field(default_factory=list)
    absent: tuple[Word, ...] = ()
    """Parts that the rig folder leaves out, whose figures are stand-ins
    (:mod:`firmware_py.machine.parts`); found, never written."""

    def tables(self) -> Iterator[tuple[str, MachineTable]]:
        """Every table with the key under which it stands in ``machine.toml``."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if isinstance(value, list):
                yield from ((f"{name}[{i}]", each) for i, each in enumerate(value))
            elif isinstance(value, MachineTable):
                yield name, value
