"""Where the lubricant enters the film: `[[feed_port]]` rows of ``machine.toml``."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from firmware_py.machine.values import AngleDeg, MachineTable, PressureBar

GROOVE: Final = "groove"
ORIFICE: Final = "orifice"
CAPILLARY: Final = "capillary"
RESTRICTED: Final = (ORIFICE, CAPILLARY)
"""Kinds with a pressure drop of their own."""


class FeedPort(MachineTable, frozen=True):
    """One opening through which the lubricant enters the film of the first bearing; as many rows
    as it has openings. A groove or port stands at its supply pressure, an orifice or capillary lets
    through what its pressure drop drives."""

    kind: Literal["groove", "port", "orifice", "capillary"]
    """`groove` or `port`: a rectangle or an ellipse that stands at the supply pressure; `orifice`,
    `capillary`: with the pressure drop of that restrictor before it. From: the drawing."""
    angle_deg: AngleDeg
    """Middle of the opening, counted as the channels' angles are (0 right, 90 up). From: the
    drawing."""
    axial_mm: Annotated[float, Meta(ge=-1000.0, le=1000.0)] = 0.0
    """Middle of the opening from the middle of the bearing along the axis, towards the shaft's end.
    From: the drawing."""
    bore_mm: Annotated[float, Meta(ge=0.01, le=100.0)] | None = None
    """Diameter of the bore: of the orifice, the capillary, or a port that is a plain hole. From:
    the drawing, or a wire gauge."""
    capillary_length_mm: Annotated[float, Meta(ge=0.1, le=10_000.0)] | None = None
    """Length of a capillary; the laminar law needs 20 bores or more. From: the drawing."""
    discharge_coefficient: Annotated[float, Meta(ge=0.3, le=1.0)] = 0.61
    """Discharge coefficient of an orifice at high Reynolds number; it falls at low ones by itself.
    From: 0.61 sharp-edged, about 0.8 rounded or long, or a flow measurement."""
    recess_width_deg: Annotated[float, Meta(ge=0.1, le=360.0)] | None = None
    """Width around the shaft of the recess, groove or port in the bore of the bearing; not given:
    the bore itself opens into the film. From: the drawing."""
    recess_length_mm: Annotated[float, Meta(ge=0.05, le=1000.0)] | None = None
    """Its length along the axis. From: the drawing."""
    recess_volume_mm3: Annotated[float, Meta(ge=0.0, le=1e7)] = 0.0
    """Volume of recess and passage behind the restrictor, which the lubricant fills; 0: nothing is
    stored. From: the drawing."""
    air_share: Annotated[float, Meta(ge=0.0, le=0.2)] = 0.0
    """Air entrained in the lubricant, share of the volume at ambient pressure; with the recess
    volume it makes the feed compressible. From: assumed, 0.01 .. 0.05 behind a tank that foams."""
    pressure_bar: PressureBar | None = None
    """Supply pressure above ambient of this opening alone; not given: that of [feed], with its
    pump. From: a gauge."""
