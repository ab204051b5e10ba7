"""Numbers per vertex, carried from one triangulation of a surface to another."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree


def transferred(
    before: Float[np.ndarray, "n 3"], arrays: Mapping[str, Float[np.ndarray, " n"]], after: Float[np.ndarray, "v 3"]
) -> dict[str, Float[np.ndarray, " v"]]:
    """Return the arrays at the points `after`: exact where a point was there before, in the same place of the array.

    Elsewhere the mean of the three nearest points, weighted by the inverse of their distance: between the values
    around, and never outside their range.
    """
    if not arrays:
        return {}
    same = np.zeros(len(after), bool)
    n = min(len(before), len(after))
    same[:n] = (before[:n] == after[:n]).all(axis=1)
    new = np.nonzero(~same)[0]
    distance, near = KDTree(before).query(after[new], k=min(3, len(before)))
    weight = 1 / np.maximum(distance, np.finfo(float).tiny ** 0.5)
    weight /= weight.sum(axis=1, keepdims=True)
    result = {}
    for name, values in arrays.items():
        result[name] = np.empty(len(after))
        result[name][same] = values[:n][same[:n]]
        result[name][new] = (weight * values[near]).sum(axis=1)
    return result
