"""The tables of ``machine.toml``: typed, a unit in every name, one place for each figure.

The text at each key is also the remark that ``orbitd rig new`` writes above it: what it means,
and after "From:" where its value is taken from.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import msgspec
from msgspec import Meta

from firmware_py.machine.feeds import FeedPort
from firmware_py.machine.sensors import (
    FastChannel,
    ForeignBus,
    MappedSignal,
    SlowChannel,
    SlowReadings,
)
from firmware_py.machine.values import (
    AngleDeg,
    BearingMassKg,
    ClearanceUm,
    LoadN,
    MachineTable,
    Name,
    OptionalWord,
    PartName,
    PressureBar,
    Section,
    Share,
    SpeedRpm,
    TemperatureC,
)


class JournalBearing(MachineTable, frozen=True):
    """The journal bearing; every clearance says radial or diametral."""

    journal_radius_m: Annotated[float, Meta(ge=0.001, le=0.5)]
    """Radius of the journal, from watch-sized shafts to the largest turbines. From: the drawing, or
    a micrometer."""
    length_m: Annotated[float, Meta(ge=0.001, le=1.0)]
    """Axial length of the film, grooves that run around left out. From: the drawing."""
    radial_clearance_min_um: ClearanceUm
    """Least radial clearance that the actuator may set; of a bearing that is fixed, that of the
    drawing. Diametral play over two. From: the drawing."""
    radial_clearance_max_um: ClearanceUm
    """Greatest radial clearance that the actuator may set; the same as the least where the
    clearance is fixed. From: the drawing."""
    radial_clearance_nominal_um: ClearanceUm
    """Radial clearance in which the machine usually runs. From: the drawing."""
    radial_clearance_offset_um: Annotated[float, Meta(ge=-100.0, le=100.0)] = 0.0
    """The bearing is so much wider than the actuator, or the drawing, tells. From: a lift check
    (half the play of the lifted shaft) less the clearance told."""
    radial_clearance_error_um: Annotated[float, Meta(ge=0.05, le=50.0)] = 5.0
    """The radial clearance is known within this. From: a lift check with a dial indicator, 3 um;
    and 10 K across the housing move it by 2 um. A drawing alone leaves half of its tolerance."""
    load_error_share: Share = 0.21
    """The film carries this much less or more than the unfed Reynolds film: rupture, inlet,
    grooves. From: a measured load, or 0.21 where grooves are not known."""
    attitude_error_deg: Annotated[float, Meta(ge=0, le=45)] = 15.0
    """The shaft stands this much off the direction of the unfed Reynolds film. From: measured
    places under a known load, or 15."""
    friction_error_share: Annotated[float, Meta(ge=0, le=1)] = 1.0
    """The film has this much less or more friction than the unfed Reynolds film; 1: the shaft power
    says nothing about the oil. From: a measured torque, or 1."""
    name: OptionalWord = ""
    """Name by which channels say where they sit; of the first bearing it may stay empty."""


class OtherBearing(JournalBearing, frozen=True):
    """A further bearing, which is watched and never controlled."""

    load_min_N: LoadN | None = None
    """Least static load on this bearing. From: the rotor's weight on it; not given: its probes are
    not held against the film at rest."""
    load_max_N: LoadN | None = None
    """Greatest static load on this bearing. From: the rotor's weight on it, and its process."""


class FixedPads(MachineTable, frozen=True):
    """Equal fixed pads instead of one round bore (lemon, three-lobe, offset halves), evenly around
    the shaft; the bearing's radial clearance is then that of the circle inscribed in them."""

    count: Annotated[int, Meta(ge=1, le=12)]
    """Number of pads. From: the drawing."""
    arc_deg: Annotated[float, Meta(ge=1.0, le=360.0)]
    """Arc of each pad; what is left of the turn between two of them is an axial groove as long as
    the bearing. From: the drawing."""
    preload: Annotated[float, Meta(ge=0.0, le=0.95)]
    """1 less the bearing's clearance over that to which the pads are machined; 0: round. From: the
    drawing, or two lift checks."""
    angle_deg: AngleDeg = 90.0
    """Middle of the first pad, counted as the channels' angles are (0 right, 90 up). From: the
    drawing."""
    offset_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5
    """Where on its arc, in the direction of rotation, each pad stands nearest to a shaft in the
    middle: 0.5 in its middle, 1 at its end (offset halves). From: the drawing."""


class Lubricant(MachineTable, frozen=True):
    """Viscosity, ``mu = mu_40 exp(-k (T - 40))`` (:mod:`~firmware_py.machine.lubricant`), and the
    inlet range that the retreat value must cover."""

    viscosity_at_40C_Pa_s: Annotated[float, Meta(ge=2e-4, le=1.5)]
    """Dynamic viscosity at 40 degC, from thinner than petrol up to ISO VG 1500: kinematic viscosity
    (1 cSt is 1e-6 m2/s) times density. From: the oil's data sheet."""
    viscosity_slope_per_K: Annotated[float, Meta(ge=0.0, le=0.1)]
    """Relative fall of the viscosity per kelvin: water 0.02, oils 0.02 .. 0.06; ln(mu_40 / mu_T) /
    (T - 40). From: two viscosities of the data sheet around the film's temperature."""
    inlet_min_C: TemperatureC
    """Coldest oil at the inlet while the machine runs. From: the oil supply, or a thermometer."""
    inlet_max_C: TemperatureC
    """Warmest oil at the inlet; the retreat value must hold with it. From: the oil supply, or a
    thermometer."""
    film_max_C: TemperatureC
    """Hottest film, and limit of the outlet. From: the oil's data sheet, and the white metal's
    limit."""
    viscosity_error_share: Share = 0.1
    """A batch of oil is this much thinner or thicker than the law. From: ISO 3448 allows each grade
    10 %; a viscometer reaches 1 %."""
    film_at_outlet: bool = False
    """Whether the film is as warm as its outlet; else it may be as cold as the coldest inlet. From:
    where the thermometer stands."""
    thermal_capacity_J_K: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """Heat capacity of the oil behind the outlet thermometer; 0: forecasts hold the oil's
    temperature. From: volume times density times heat capacity, or a step of the load."""
    cooling_W_K: Annotated[float, Meta(ge=0.0, le=1e5)] = 0.0
    """Heat that the oil carries away per kelvin above its inlet. From: flow times density times
    heat capacity."""
    density_kg_m3: Annotated[float, Meta(ge=100.0, le=3000.0)] = 870.0
    """Density of the lubricant. From: its data sheet."""
    heat_capacity_J_kgK: Annotated[float, Meta(ge=500.0, le=10_000.0)] = 2000.0
    """Specific heat capacity; a mineral oil has 2000, water 4180. From: a data sheet or a book of
    tables."""


class Feed(MachineTable, frozen=True):
    """Oil supply pressure above ambient: what the actuator may set."""

    pressure_min_bar: PressureBar
    """Least supply pressure above ambient that may be set, or that a healthy supply has. From: the
    supply's gauge."""
    pressure_max_bar: PressureBar
    """Greatest supply pressure above ambient. From: the supply's relief valve."""
    groove_area_min_mm2: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """A groove opposite the load presses the shaft down like a piston of at least this area; 0: no
    groove. From: the drawing; nothing less than the groove itself."""
    groove_area_max_mm2: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """And of at most this area; 0: no groove. From: the drawing; the groove and the film around it,
    at most the projected bearing."""
    pressure_nominal_bar: PressureBar | None = None
    """Supply pressure in normal service. From: the supply's gauge."""
    groove_angle_deg: AngleDeg | None = None
    """Middle of one axial groove, counted as the channels' angles are (0 right, 90 up); 90 is
    opposite a downward load. From: the drawing."""
    groove_width_deg: Annotated[float, Meta(ge=0.5, le=180.0)] | None = None
    """Width of the groove around the shaft. From: the drawing."""
    groove_length_share: Annotated[float, Meta(ge=0.01, le=1.0)] | None = None
    """Length of the groove as a share of the bearing's. From: the drawing."""
    full_film_bar: PressureBar | None = None
    """Below this pressure the film is not full; not given: half of the least pressure. The danger
    limit of the pressure follows from it. From: a trial, or half of the least pressure."""
    pump_shut_off_bar: Annotated[float, Meta(ge=0.01, le=1000.0)] | None = None
    """What the pump, or its relief valve, gives at no flow; it falls evenly to nothing at the
    pump's greatest flow. Not given: any pressure at any flow. From: the pump's data sheet."""
    pump_flow_max_m3_s: Annotated[float, Meta(ge=1e-9, le=10.0)] | None = None
    """Flow of the pump against no pressure. From: the pump's data sheet."""
    hold_up_s: Annotated[float, Meta(ge=0.0, le=3600.0)] = 0.0
    """Time constant with which the pressure falls after the loss of the pump (accumulator and check
    valve); 0: none, it falls as fast as it follows its target. From: a trial."""
    pump_error_share: Share = 0.1
    """The pump gives, and the hold-up lasts, at most this much less than that. From: the spread of
    its data sheet."""
    pump_efficiency: Annotated[float, Meta(ge=0.05, le=1.0)] = 0.6
    """Of the pump with its motor: what the supply costs. From: its data sheet."""
    jacket_flow_m3_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.0
    """Forced flow around the film, which takes its heat away; 0: none. From: a flow meter."""


class RotorDrawing(MachineTable, frozen=True):
    """A rigid rotor between a coupling and the bearing; distances are from its centre of gravity.

    Either its drawing (mass, diametral inertia, both distances) or its effective mass at the
    bearing is given.
    """

    unbalance_normal_kg_m: Annotated[float, Meta(ge=0.0, le=100.0)]
    """Greatest unbalance of a healthy rotor in the plane of the bearing; of grade G (mm/s) it is
    G/1000 times the mass over the speed in rad/s. From: the balancing protocol, or the grade (ISO
    21940-11)."""
    mass_error_share: Share = 0.05
    """The built rotor is heavier than its drawing by at most this share. From: 0.05 of a drawing,
    0.005 where it was weighed."""
    unbalance_measured: bool = False
    """Whether the normal unbalance is this rotor's own, from balancing; else it is the most that
    its grade lets any have. From: the balancing protocol."""
    whirl_error_share: Share = 0.05
    """The speed at which it whirls lies at most this much below that of a rigid rotor on the film:
    coupling, pedestal, gyroscopic moments. From: 0.05, or an analysis of the whole train."""
    shaft_power_error_W: Annotated[float, Meta(ge=0.01, le=1e6)] = 5.0
    """Error of the shaft power that the rig reports. From: 0.1 % of the torque meter's range times
    the greatest speed (4 N m at 12000 rpm: 5 W); less where its zero was taken at rest."""
    windage_W_s3: Annotated[float, Meta(ge=0.0, le=1e-3)] = 0.0
    """Shaft power beside the film's, over the cubed speed in rad/s. From: a coast-down without the
    bearing's oil, or 0."""
    effective_mass_at_bearing_kg: BearingMassKg | None = None
    """Force over acceleration at the bearing, of a rotor that was weighed: that in forward whirl
    (inertia J_d - J_p / 0.515); it counts before that of the drawing. From: weighing and a
    pendulum."""
    mass_kg: Annotated[float, Meta(ge=0.001, le=1e6)] | None = None
    """Mass of the rotor, without what hangs behind the coupling. From: a balance, or the
    drawing."""
    diametral_inertia_kg_m2: Annotated[float, Meta(ge=1e-9, le=1e9)] | None = None
    """Moment of inertia about a diameter through the centre of gravity; a plain shaft has mass
    times length squared over 12. From: the drawing, or a pendulum."""
    polar_inertia_kg_m2: Annotated[float, Meta(ge=1e-9, le=1e9)] | None = None
    """Moment of inertia about the axis; at most twice the diametral one. From: the drawing."""
    coupling_to_cg_m: Annotated[float, Meta(ge=0.001, le=100.0)] | None = None
    """From the coupling, about which the rotor swings, to the centre of gravity. From: the
    drawing."""
    bearing_to_cg_m: Annotated[float, Meta(ge=0.0, le=100.0)] | None = None
    """From the middle of the bearing to the centre of gravity, on the other side than the coupling.
    From: the drawing."""
    shaft_end_to_cg_m: Annotated[float, Meta(ge=0.001, le=100.0)] | None = None
    """From the end of the shaft on the bearing's side to the centre of gravity. From: the
    drawing."""
    coupling_stiffness_N_m: Annotated[float, Meta(ge=1.0, le=1e13)] | None = None
    """Radial stiffness of the coupling's end: of its support, or of the other bearing. From: its
    data sheet, or a force and a dial."""
    coupling_damping_N_s_m: Annotated[float, Meta(ge=0.0, le=1e9)] | None = None
    """Radial damping there. From: assumed, a rubber coupling about 500."""

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
    """Supply of the contact circuit, which an open contact shows; the wire carries up to 3.2767 V.
    From: its design."""
    circuit_ohm: Annotated[float, Meta(ge=1.0, le=1e9)]
    """Series resistor of the contact circuit. From: its design."""
    film_ohm_per_m: Annotated[float, Meta(ge=1e3, le=1e15)]
    """Resistance of the film over its least thickness. From: a measurement at a known film."""
    film_error_share: Annotated[float, Meta(ge=1e-3, le=1.0)]
    """Standard deviation of the film's resistance as a share of it. From: repeated measurements."""


class OperatingRange(MachineTable, frozen=True):
    """The declared range: protection, shield and the retreat value answer for all of it."""

    speed_min_rpm: SpeedRpm
    """Slowest speed in service: the retreat value must carry the load there. From: the machine's
    duty."""
    speed_max_rpm: SpeedRpm
    """Fastest speed in service. From: the machine's duty; 1.1 times it trips."""
    load_min_N: LoadN
    """Least static load on this bearing, downward: whirl begins there. From: the rotor's weight on
    this bearing, and its process."""
    load_max_N: LoadN
    """Greatest static load on this bearing, downward. From: the rotor's weight on this bearing, and
    its process."""
    speed_ramp_max_rpm_s: Annotated[float, Meta(ge=1.0, le=1e5)]
    """Fastest ramp of the speed, announced or not. From: the drive."""
    speed_ramp_unannounced_rpm_s: Annotated[float, Meta(ge=1.0, le=1e5)]
    """Fastest ramp of the speed that comes unannounced; faster ones are announced before they start
    (command `announce`). From: the drive."""
    load_ramp_unannounced_N_s: Annotated[float, Meta(ge=0.01, le=1e6)]
    """Fastest change of the load that comes unannounced. From: the process."""


class ClearanceActuator(MachineTable, frozen=True):
    """The node's promises; ``safe`` must equal what the node boots with."""

    safe_radial_clearance_um: ClearanceUm
    """Retreat value of the radial clearance: the node boots with it and goes back to it; admissible
    over the whole operating range. From: `orbitd check`, which names those that are."""
    safe_pressure_bar: PressureBar
    """Retreat value of the supply pressure, with which the node boots. From: the supply."""
    rate_um_s: Annotated[float, Meta(ge=1.0, le=6500.0)]
    """Greatest rate of the radial clearance; the wire carries up to 6553.5 um/s. From: the
    actuator's data sheet."""
    time_constant_s: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.05
    """Lag of the clearance behind its target. From: a step of the actuator."""
    time_to_live_ms: Annotated[int, Meta(ge=10, le=1000)] = 100
    """Age at which the node drops a command and goes to the retreat value. From: the node."""
    command_period_ms: Annotated[int, Meta(ge=1, le=100)] = 20
    """Period of the commands; at least three in a time to live. From: the node."""
    pressure_dead_time_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    """The supply pressure does not move for so long after its target has. From: a step of the
    supply."""
    pressure_time_constant_s: Annotated[float, Meta(ge=0.01, le=60)] = 1.0
    """Lag of the supply pressure behind its target after the dead time, as the simulator plays it;
    three of them pass before an error counts. From: a step of the supply."""
    pressure_slew_bar_s: Annotated[float, Meta(ge=0.01, le=1e4)] | None = None
    """And no faster than this; not given: as fast as the lag lets it. From: a step of the
    supply."""
    pressure_error_share: Share = 0.0
    """Dead time and lag are at most this much longer, and the slew this much slower, than that.
    From: repeated steps."""
    following_error_um: Annotated[float, Meta(ge=0.1, le=1000)] = 5.0
    """The measured clearance may lie this far beyond where an actuator of the declared rate can be.
    From: backlash, noise and error of its gauge."""
    following_error_bar: Annotated[float, Meta(ge=0.01, le=100)] = 0.3
    """And the measured supply pressure. From: the error of its gauge."""
    following_time_s: Annotated[float, Meta(ge=0.5, le=30)] = 2.0
    """For this long, before it is an alarm; gross errors and slow movement are one sooner. From: a
    choice."""
    reversals_per_minute_max: Annotated[int, Meta(ge=2, le=6000)] = 300
    """The target may turn back this often within a minute; then authority goes, and a set point
    holds. From: what the actuator's wear allows."""
    backlash_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    """Play of the clearance actuator. From: a dial indicator, from both sides."""
    position_noise_um: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.2
    """Deviation (rms) of the measured clearance. From: readings at rest."""


class Machine(Section, frozen=True):
    """One machine: all that is true of it, however the device runs there."""

    name: Name
    """Name of the machine: small letters, digits, - and _."""
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
    pads: FixedPads | None = None
    feed_port: Annotated[list[FeedPort], Meta(max_length=24)] = msgspec.field(default_factory=list)
    """Openings of the feed in the first bearing; none: plain, or the groove of [feed]."""
    other_bearing: list[OtherBearing] = msgspec.field(default_factory=list)
    foreign: ForeignBus | None = None
    map: list[MappedSignal] = msgspec.field(default_factory=list)
    absent: tuple[PartName, ...] = ()
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
