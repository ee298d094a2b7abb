"""The rotor rig in software: what stands in for the machine when there is none."""

from typing import TYPE_CHECKING, Any

from .compiled import keep_compiled

keep_compiled()  # before anything imports numba

if TYPE_CHECKING:
    from .film import Equilibrium, FeedPatch, FilmForce, equilibrium, film_force
    from .plant.duty import Duty
    from .plant.power_map import PowerMap, power_map
    from .plant.response import Trajectory, simulate
    from .rigs import RigData, load_rig
    from .rotor.modes import Modes, Support, modes

__all__ = [
    "Duty",
    "Equilibrium",
    "FeedPatch",
    "FilmForce",
    "Modes",
    "PowerMap",
    "RigData",
    "Support",
    "Trajectory",
    "equilibrium",
    "film_force",
    "load_rig",
    "modes",
    "power_map",
    "simulate",
]

_HOMES = {
    "Duty": ".plant.duty",
    "Equilibrium": ".film",
    "FeedPatch": ".film",
    "FilmForce": ".film",
    "Modes": ".rotor.modes",
    "PowerMap": ".plant.power_map",
    "RigData": ".rigs",
    "Support": ".rotor.modes",
    "Trajectory": ".plant.response",
    "equilibrium": ".film",
    "film_force": ".film",
    "load_rig": ".rigs",
    "modes": ".rotor.modes",
    "power_map": ".plant.power_map",
    "simulate": ".plant.response",
}


def __getattr__(name: str) -> Any:
    """Import film and rotor, and with them the compiler, only when they are asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name], __name__), name)
