"""Modes of a rigid rotor on linear supports, with gyroscopic moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.errors import OrbitdError

Floats = NDArray[np.float64]


class ModesError(OrbitdError, ValueError):
    """Mass, inertia or supports that no rotor can have."""

    exit_code = 2


class Support(NamedTuple):
    """A bearing or coupling: stiffness and damping in (x, y), N/m and N s/m, at `z_m` from the
    centre of gravity."""

    z_m: float
    stiffness_N_m: float | Floats
    damping_N_s_m: float | Floats = 0.0


@dataclass(frozen=True)
class Modes:
    """Damped modes by rising frequency: one for each pair of eigenvalues, and each real eigenvalue.

    Parameters
    ----------
    eigenvalue_1_s
        Shape (n,), imaginary part not negative, 1/s.
    shape
        Displacements (x, y, A, B) of each mode, shape (n, 4), complex.
    forward
        +1 where the larger motion of the two ends whirls with the rotation's positive sense, -1
        against it, 0 where it is a straight line; shape (n,).
    """

    eigenvalue_1_s: NDArray[np.complex128]
    shape: NDArray[np.complex128]
    forward: NDArray[np.int64]

    @property
    def frequency_rad_s(self) -> Floats:
        """Damped natural frequencies, rad/s."""
        return np.asarray(self.eigenvalue_1_s.imag)

    @property
    def damping_ratio(self) -> Floats:
        """Share of critical damping; negative is unstable, zero for a motion that nothing
        restores."""
        size = np.abs(self.eigenvalue_1_s)
        return np.asarray(-self.eigenvalue_1_s.real / np.where(size > 0, size, 1.0))


def modes(
    m: float,
    J_d: float,
    J_p: float,
    supports: Sequence[Support | tuple[float, ...]],
    speed_rad_s: float,
) -> Modes:
    """Modes of `M q'' + (C + omega G) q' + K q = 0`, `q = (x, y, A, B)`, `A = dx/dz`, `B = dy/dz`.

    Parameters
    ----------
    m, J_d, J_p
        Mass, kg, diametral and polar moment of inertia, kg m2.
    supports
        Where and how the rotor is held: `Support` or plain tuples (z, stiffness, damping).
    speed_rad_s
        Any sign or zero.

    Raises
    ------
    ModesError
        Mass or inertia not above zero, or nothing that holds the rotor.
    """
    values, vectors = np.linalg.eig(state_matrix(m, J_d, J_p, supports, speed_rad_s))
    kept = np.flatnonzero(values.imag >= -1e-9 * np.abs(values).max())
    kept = kept[np.argsort(values[kept].imag, kind="stable")]
    shapes = vectors[:4, kept].T
    reach = max(abs(Support(*s).z_m) for s in supports)
    return Modes(values[kept].astype(np.complex128), shapes, _senses(shapes, reach))


def state_matrix(
    m: float,
    J_d: float,
    J_p: float,
    supports: Sequence[Support | tuple[float, ...]],
    speed_rad_s: float,
) -> Floats:
    """The matrix of `d(q, q')/dt`, shape (8, 8); arguments and errors as `modes`."""
    for name, value in (("m", m), ("J_d", J_d)):
        if not (np.isfinite(value) and value > 0):
            raise ModesError(f"{name} = {value}: must be finite and above zero")
    if not (np.isfinite(J_p) and J_p >= 0 and np.isfinite(speed_rad_s)):
        raise ModesError(
            f"J_p = {J_p}, speed_rad_s = {speed_rad_s}: must be finite, J_p not negative"
        )
    if not supports:
        raise ModesError("supports: none given; a rotor without supports has no modes")
    held = [Support(*s) for s in supports]
    inverse = np.diag(1 / np.array([m, m, J_d, J_d]))
    damping = np.sum([_lifted(s.z_m, s.damping_N_s_m) for s in held], axis=0)
    damping[2, 3] += J_p * speed_rad_s
    damping[3, 2] -= J_p * speed_rad_s
    system = np.zeros((8, 8))
    system[:4, 4:] = np.eye(4)
    system[4:, :4] = -inverse @ np.sum([_lifted(s.z_m, s.stiffness_N_m) for s in held], axis=0)
    system[4:, 4:] = -inverse @ damping
    return system


def _lifted(z: float, matrix: float | Floats) -> Floats:
    """A 2 x 2 (or isotropic) support at `z` in the rotor's coordinates, shape (4, 4)."""
    block = np.asarray(matrix, dtype=np.float64)
    block = block * np.eye(2) if block.ndim == 0 else block
    reach = np.hstack([np.eye(2), z * np.eye(2)])
    return np.asarray(reach.T @ block @ reach)


def _senses(shapes: NDArray[np.complex128], reach: float) -> NDArray[np.int64]:
    """Sense of whirl where the rotor moves most, of both ends at `reach` (or 1 m for a rotor held
    at its middle)."""
    senses = []
    for x, y, a, b in shapes:
        ends = [(x + z * a, y + z * b) for z in (-(reach or 1.0), reach or 1.0)]
        u, v = max(ends, key=lambda end: abs(end[0]) ** 2 + abs(end[1]) ** 2)
        turn = float((np.conj(u) * v).imag) / (abs(u) ** 2 + abs(v) ** 2)
        senses.append(0 if abs(turn) < 1e-6 else -1 if turn > 0 else 1)
    return np.array(senses)
