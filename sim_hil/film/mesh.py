"""The finite-volume mesh of the unwrapped film."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from .bore import PadBore
from .records import FeedPatch, FilmError, Floats

# The flow is singular at the corners of a port (pressure as r^(2/3)): cells there are this much
# thinner than even.
_EDGE_GRADING = 0.9
# Axial intervals on either side of a port's end, at least.
_PORT_INTERVALS = 6


@dataclass(frozen=True)
class Mesh:
    """Nodes, faces, fixed pressures; lengths in journal radii, z from the middle plane or over both
    halves.

    Face i lies between nodes i and i + 1 (the last theta face closes the ring). `copies` is 2 when
    only one half of a symmetric film is meshed. `fixed` marks nodes of known pressure `fixed_Pa`,
    `port` those in a feed, `place` in which one (-1: none).
    """

    theta: Floats
    theta_face: Floats
    theta_gap: Floats
    theta_width: Floats
    z: Floats
    z_gap: Floats
    z_width: Floats
    z_weight: Floats
    copies: int
    fixed: np.ndarray
    fixed_Pa: Floats
    port: np.ndarray
    place: np.ndarray


def build_mesh(
    *,
    radius_m: float,
    length_m: float,
    feed: Sequence[FeedPatch],
    end_pressure_Pa: tuple[float, float],
    nodes: tuple[int, int],
    hmax_rad: float,
    eccentricity_ratio: float,
    inlet_Pa: float | None,
    pads: PadBore | None = None,
) -> Mesh:
    """Mesh with nodes on every port edge, denser towards the smallest film.

    Parameters
    ----------
    nodes
        Nodes around the ring and intervals along the whole length.
    hmax_rad
        Angle of the thickest film; a film without feed starts its grid there.
    eccentricity_ratio
        Sets the density at the smallest film; 0 for a uniform grid.
    inlet_Pa
        Pressure of an axial inlet line at `hmax_rad`, None for a closed ring.
    pads
        Where they meet without a groove a node stands.
    """
    ports = [_port_extent(f, radius_m, length_m) for f in feed]
    edges = [a + s * w / 2 for (a, w, *_) in ports if w < 2 * np.pi for s in (-1, 1)]
    if pads is not None and not pads.gap_rad:
        edges += [float(angle) for angle in pads.seams_rad]
    if inlet_Pa is not None or not edges:
        edges.append(hmax_rad)
    theta = _ring_nodes(edges, nodes[0], hmax_rad, (1 - eccentricity_ratio) ** -0.25, bool(ports))
    symmetric = end_pressure_Pa[0] == end_pressure_Pa[1] and not any(f.axial_m for f in feed)
    z = _axial_nodes(ports, length_m / radius_m, nodes[1], symmetric)
    fixed, fixed_Pa, place = _fixed_pressures(
        theta, z, ports, feed, end_pressure_Pa, hmax_rad, inlet_Pa
    )
    theta_gap = np.diff(np.append(theta, theta[0] + 2 * np.pi))
    z_gap = np.diff(z)
    z_width = np.append(z_gap, 0.0) / 2 + np.append(0.0, z_gap) / 2
    return Mesh(
        theta=theta,
        theta_face=theta + theta_gap / 2,
        theta_gap=theta_gap,
        theta_width=(theta_gap + np.roll(theta_gap, 1)) / 2,
        z=z,
        z_gap=z_gap,
        z_width=z_width,
        z_weight=_parabola_weights(z_gap),
        copies=2 if symmetric else 1,
        fixed=fixed,
        fixed_Pa=fixed_Pa,
        port=place >= 0,
        place=place,
    )


class _PortExtent(NamedTuple):
    """The rectangle that stands for a port: centre and width around, rad; half length and centre
    along, radii."""

    angle: float
    width: float
    half: float
    middle: float


def _port_extent(feed: FeedPatch, radius_m: float, length_m: float) -> _PortExtent:
    values = (feed.angle_rad, feed.width_rad, feed.length_m, feed.pressure_Pa, feed.axial_m)
    if feed.kind not in ("groove", "orifice"):
        raise FilmError(f"feed kind {feed.kind!r}: use 'groove' or 'orifice'")
    if not np.all(np.isfinite(values)):
        raise FilmError(f"feed {feed}: every number must be finite")
    if not (0 < feed.width_rad <= 2 * np.pi and 0 < feed.length_m <= length_m):
        raise FilmError(
            f"feed {feed}: width must be in (0, 2 pi] rad and length in (0, {length_m}] m"
        )
    if feed.axial_m and abs(feed.axial_m) + feed.length_m / 2 >= length_m / 2:
        raise FilmError(
            f"feed {feed}: {abs(feed.axial_m):g} m from the middle and half of {feed.length_m:g} m "
            f"reach the end of the bearing at {length_m / 2:g} m"
        )
    shrink = np.sqrt(np.pi) / 2 if feed.kind == "orifice" else 1.0
    half = feed.length_m * shrink / (2 * radius_m)
    return _PortExtent(feed.angle_rad, feed.width_rad * shrink, half, feed.axial_m / radius_m)


def _ring_nodes(
    edges: list[float], count: int, hmax_rad: float, stretch: float, ports: bool
) -> Floats:
    """Nodes of the ring: the edges, and between them nodes even (or denser at the edges) in the
    stretched angle.

    The stretched angle `g` with `tan(psi / 2) = k tan(g / 2)`, `psi` from the thickest film, packs
    nodes at the smallest film k^2 times closer than at the thickest (Sommerfeld's substitution,
    another exponent).
    """
    turn = 2 * np.pi
    start = edges[0]
    offsets = sorted({round((e - start) % turn, 12) % turn for e in edges})
    spans = np.diff([*offsets, turn])
    counts = [max(2, round(count * span / turn)) for span in spans]
    k = min(stretch, 4.0)
    nodes = []
    for offset, span, n in zip(offsets, spans, counts, strict=True):
        first = _stretch(start + offset - hmax_rad, 1 / k)
        last = _stretch(start + offset + span - hmax_rad, 1 / k)
        last = last + turn if last <= first else last
        part = _packed(np.arange(n) / n, ports, ports)
        nodes.append(_stretch(first + (last - first) * part, k) + hmax_rad)
    return np.concatenate(nodes)


def _stretch(angle: Floats | float, k: float) -> Floats:
    """Angle `b` on the same turn as `angle` with `tan(b / 2) = k tan(angle / 2)`."""
    a = np.asarray(angle, dtype=np.float64)
    turns = np.floor(a / (2 * np.pi) + 0.5)
    rest = a / 2 - np.pi * turns
    return np.asarray(2 * np.arctan2(k * np.sin(rest), np.cos(rest)) + 2 * np.pi * turns)


def _axial_nodes(
    ports: Sequence[_PortExtent], length: float, intervals: int, symmetric: bool
) -> Floats:
    """Nodes along the axis, on every port end and denser there; one half (from the middle plane)
    when symmetric."""
    if any(port.middle for port in ports):
        return _uneven_axial_nodes(ports, length, intervals)
    ends = {min(port.half, length / 2) for port in ports} - {length / 2}
    edges = sorted({0.0, length / 2, *ends})
    parts = []
    for a, b in pairwise(edges):
        n = max(_PORT_INTERVALS if ends else 3, round(intervals * (b - a) / length))
        parts.append(a + (b - a) * _packed(np.arange(n) / n, a in ends, b in ends))
    half = np.append(np.concatenate(parts), length / 2)
    return half if symmetric else np.concatenate([-half[:0:-1], half])


def _uneven_axial_nodes(ports: Sequence[_PortExtent], length: float, intervals: int) -> Floats:
    """Nodes over the whole length with ports anywhere along it."""
    found = sorted(
        {
            round(min(max(end, -length / 2), length / 2), 12)
            for port in ports
            for end in (port.middle - port.half, port.middle + port.half)
        }
        - {-length / 2, length / 2}
    )
    parts = []
    for a, b in pairwise([-length / 2, *found, length / 2]):
        n = max(_PORT_INTERVALS // 2, round(intervals * (b - a) / length))
        inner = _packed(np.arange(n) / n, a > -length / 2, b < length / 2)
        parts.append(a + (b - a) * inner)
    return np.append(np.concatenate(parts), length / 2)


def _packed(even: Floats, first: bool, last: bool) -> Floats:
    """Places in [0, 1] that lie closer at the ends asked for."""
    if first and last:
        return even - _EDGE_GRADING * np.sin(2 * np.pi * even) / (2 * np.pi)
    one_side = _EDGE_GRADING * np.sin(np.pi * even) / np.pi * (int(last) - int(first))
    return np.asarray(even + one_side)


def _parabola_weights(gap: Floats) -> Floats:
    """Quadrature weights on uneven nodes: every interval under the mean of its two neighbouring
    parabolas.

    Exact for the parabola of a short bearing; on even nodes the trapezoidal rule with end
    correction.
    """
    a, b = gap[:-1], gap[1:]
    first = (
        np.array([a * (2 * a + 3 * b) / (a + b), a * (a + 3 * b) / b, -(a**3) / (b * (a + b))]) / 6
    )
    second = (
        np.array([-(b**3) / (a * (a + b)), b * (b + 3 * a) / a, b * (2 * b + 3 * a) / (a + b)]) / 6
    )
    share_first, share_second = np.full(a.size, 0.5), np.full(a.size, 0.5)
    share_first[0] = share_second[-1] = 1.0
    weight = np.zeros(gap.size + 1)
    for k in range(3):
        weight[k : k + a.size] += share_first * first[k] + share_second * second[k]
    return weight


def _fixed_pressures(
    theta: Floats,
    z: Floats,
    ports: Sequence[_PortExtent],
    feed: Sequence[FeedPatch],
    end_pressure_Pa: tuple[float, float],
    hmax_rad: float,
    inlet_Pa: float | None,
) -> tuple[np.ndarray, Floats, np.ndarray]:
    shape = (theta.size, z.size)
    fixed = np.zeros(shape, dtype=np.bool_)
    pressure = np.zeros(shape)
    place = np.full(shape, -1)
    if inlet_Pa is not None:
        line = np.abs(np.remainder(theta - hmax_rad + np.pi, 2 * np.pi) - np.pi) < 1e-9
        place[line, :] = len(ports)
        fixed[line, :] = True
        pressure[line, :] = inlet_Pa
    for k, ((angle, width, half, middle), one) in enumerate(zip(ports, feed, strict=True)):
        around = np.abs(np.remainder(theta - angle + np.pi, 2 * np.pi) - np.pi) <= width / 2 + 1e-9
        inside = around[:, None] & (np.abs(z - middle) <= half + 1e-9)[None, :]
        place[inside] = k
        fixed |= inside
        pressure[inside] = one.pressure_Pa
    ends = (
        [(-1, end_pressure_Pa[1])]
        if z[0] == 0.0
        else [(0, end_pressure_Pa[0]), (-1, end_pressure_Pa[1])]
    )
    for j, value in ends:
        fixed[:, j] = True
        pressure[:, j] = np.where(place[:, j] >= 0, pressure[:, j], value)
    return fixed, pressure, place
