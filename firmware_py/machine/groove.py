"""What a groove opposite the load adds to it: the supply pressure presses the shaft as on a piston.

Where the shaft runs, the film with a groove carries less than the film without: less by the
pressure on an area between two bounds.  It whirls no earlier, but for 0.7 % of speed, than that
film does under the static load and the pressure on the smaller area
(:mod:`sim_hil.film.groove_load` measures both).  So the laws of the film without groove hold for
the **load of the film**, the static one and the piston's together, which is also what the place of
the shaft shows.
"""

from __future__ import annotations

from typing import Final

from firmware_py.machine.schema import Machine

N_PER_BAR_MM2: Final = 0.1


class Groove:
    """Bounds of the film's load, N.

    Parameters
    ----------
    machine
        The feed's pressures and areas, and the declared range of the static load.

    Attributes
    ----------
    added_N
        The least and the most that the piston adds, whatever pressure is set.
    film_loads_N
        Declared range of the film's load.
    """

    def __init__(self, machine: Machine) -> None:
        feed, o = machine.feed, machine.operating
        self._pressures_bar = feed.pressure_min_bar, feed.pressure_max_bar
        self._most_N_bar = N_PER_BAR_MM2 * feed.groove_area_max_mm2
        self.added_N = (
            N_PER_BAR_MM2 * feed.groove_area_min_mm2 * feed.pressure_min_bar,
            self._most_N_bar * feed.pressure_max_bar,
        )
        self.film_loads_N = o.load_min_N + self.added_N[0], o.load_max_N + self.added_N[1]

    def swing_N(self, pressure_bar: float) -> tuple[float, float]:
        """How much less and more the film may carry than at this pressure: any other may follow
        within a retreat."""
        low_bar, high_bar = self._pressures_bar
        return (
            self._most_N_bar * max(0.0, pressure_bar - low_bar),
            self._most_N_bar * max(0.0, high_bar - pressure_bar),
        )
