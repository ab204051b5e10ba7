"""Tutte's embedding: every interior node at the mean of its neighbours (valid for convex boundaries)."""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, csc_matrix, diags_array
from scipy.sparse.linalg import splu


def tutte(boundary: Float[np.ndarray, "l 2"], edges: Int[np.ndarray, "e 2"], size: int) -> Float[np.ndarray, "p 2"]:
    """Return positions of `size` nodes, the first L of them at `boundary`, in equilibrium along `edges`."""
    fixed = len(boundary)
    weight = coo_matrix((np.ones(len(edges)), edges.T), (size, size)).tocsr()
    weight = weight + weight.T
    laplacian = (diags_array(np.asarray(weight.sum(axis=1)).ravel()) - weight).tocsr()[fixed:]
    inner = splu(csc_matrix(laplacian[:, fixed:]), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return np.concatenate([boundary, inner.solve(-(laplacian[:, :fixed] @ boundary))])
