"""The rigs that the simulator plays: what a rig folder says of one, read into frozen figures."""

from __future__ import annotations

from sim_hil.rigs.data import (
    ActuatorData,
    AxialGroove,
    BearingData,
    ChannelData,
    OilData,
    ReadingErrors,
    RigData,
    RotorData,
    SupplyData,
    ThermalData,
)
from sim_hil.rigs.loading import RIGS, NotSimulated, UnknownRig, load_rig, rig_of

__all__ = [
    "RIGS",
    "ActuatorData",
    "AxialGroove",
    "BearingData",
    "ChannelData",
    "NotSimulated",
    "OilData",
    "ReadingErrors",
    "RigData",
    "RotorData",
    "SupplyData",
    "ThermalData",
    "UnknownRig",
    "load_rig",
    "rig_of",
]
