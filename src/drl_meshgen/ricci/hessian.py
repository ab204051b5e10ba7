"""The sparse Hessian of the Ricci energy (eq. 5) and the linear solver of Newton's step (eq. 6)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, splu

from drl_meshgen.ricci.triangulation import Triangulation

MAX_CG = 30


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where each slot's weight goes in the symmetric matrix over the free vertices of a triangulation."""

    n_vertices: int
    free: Int[np.ndarray, " n"]
    tails: Int[np.ndarray, " s"]
    heads: Int[np.ndarray, " s"]
    linked: Int[np.ndarray, " o"]
    pair_of: Int[np.ndarray, " o"]
    order: Int[np.ndarray, " z"]
    indices: Int[np.ndarray, " z"]
    indptr: Int[np.ndarray, " n1"]

    @classmethod
    def of(cls, triangulation: Triangulation, free: Int[np.ndarray, " n"], n_vertices: int) -> "Pattern":
        """Return the pattern over the vertices `free`. Sides that join the same two vertices share an entry."""
        tails, heads = triangulation.tails.ravel(), triangulation.heads.ravel()
        n = len(free)
        index = np.full(n_vertices, -1)
        index[free] = np.arange(n)
        i, j = index[tails], index[heads]
        linked = np.nonzero((i >= 0) & (j >= 0) & (i != j))[0]
        low, high = np.minimum(i[linked], j[linked]), np.maximum(i[linked], j[linked])
        code, pair_of = np.unique(low * np.int64(n) + high, return_inverse=True)
        low, high = code // n, code % n
        row, column = np.r_[np.arange(n), low, high], np.r_[np.arange(n), high, low]
        entry = np.r_[np.arange(n + len(code)), n + np.arange(len(code))]
        matrix = coo_matrix((entry + 1, (row, column)), (n, n)).tocsc()  # + 1: no stored zero
        return cls(n_vertices, free, tails, heads, linked, pair_of, matrix.data - 1, matrix.indices, matrix.indptr)

    def matrix(
        self, on_diagonal: Float[np.ndarray, " s"], off_diagonal: Float[np.ndarray, " s"], ridge: float = 0.0
    ) -> csc_matrix:
        """Sum the block `[[d, o], [o, d]]` of every slot between its end vertices, plus `ridge` times the identity."""
        diagonal = np.bincount(self.tails, on_diagonal, self.n_vertices)
        diagonal += np.bincount(self.heads, on_diagonal, self.n_vertices)
        pairs = np.bincount(self.pair_of, off_diagonal[self.linked])
        data = np.r_[diagonal[self.free] + ridge, pairs][self.order]
        return csc_matrix((data, self.indices, self.indptr), (len(self.free),) * 2)


def factorise(matrix: csc_matrix) -> SuperLU:
    """Return the LU factors of a matrix with symmetric pattern, without pivoting off the diagonal."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


class StaleFactor:
    """Solves a sequence of slowly changing positive definite systems with as few factorisations as possible.

    The cotangent weights are conformally invariant in the limit, so an old factor stays a good preconditioner of the
    conjugate gradients for the next Hessian.
    """

    def __init__(self) -> None:
        self._factor: SuperLU | None = None

    def solve(
        self, matrix: csc_matrix, rhs: Float[np.ndarray, " n"], tolerance: float
    ) -> tuple[Float[np.ndarray, " n"], int, bool]:
        """Return the solution, the number of CG iterations and whether the matrix was factorised anew.

        `tolerance` is relative to the right-hand side's norm.
        """
        iterations = 0
        factor = self._factor
        if factor is not None:

            def count(_: np.ndarray) -> None:
                nonlocal iterations
                iterations += 1

            preconditioner = LinearOperator(matrix.shape, factor.solve)
            x, failed = cg(matrix, rhs, rtol=tolerance, maxiter=MAX_CG, M=preconditioner, callback=count)
            if not failed:
                return x, iterations, False
        factor = self._factor = factorise(matrix)
        return factor.solve(rhs), iterations, True
