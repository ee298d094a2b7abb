"""Coefficients of uniform cubic B-splines through given values; `table_kernel` and `fed_kernel`
evaluate them."""

import numpy as np

from .records import Floats


def line_coefficients(values: Floats, axis: int) -> Floats:
    """Coefficients along an open axis (not-a-knot ends): one more on each side than there are
    values."""
    rows = np.moveaxis(values, axis, 0)
    padded = np.pad(rows, ((1, 1), *((0, 0),) * (rows.ndim - 1)))
    solved = np.linalg.solve(_not_a_knot(rows.shape[0]), padded.reshape(padded.shape[0], -1))
    return np.moveaxis(np.asarray(solved, dtype=np.float64).reshape(padded.shape), 0, axis)


def ring_coefficients(values: Floats, axis: int) -> Floats:
    """Coefficients along a periodic axis, as many as values: the collocation is a product of their
    waves."""
    rows = np.moveaxis(values, axis, -1)
    smoothing = (2 + np.cos(2 * np.pi * np.arange(rows.shape[-1]) / rows.shape[-1])) / 3
    ring: Floats = np.fft.ifft(np.fft.fft(rows, axis=-1) / smoothing, axis=-1).real
    return np.moveaxis(ring, -1, axis)


def _not_a_knot(count: int) -> Floats:
    """Collocation matrix of a uniform cubic B-spline with zero fourth difference at either end."""
    matrix = np.zeros((count + 2, count + 2))
    for k in range(1, count + 1):
        matrix[k, k - 1 : k + 2] = np.array([1, 4, 1]) / 6
    matrix[0, :5] = matrix[-1, -5:] = [1, -4, 6, -4, 1]
    return matrix
