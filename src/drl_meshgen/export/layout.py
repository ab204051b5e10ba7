"""The block layout of a mesh as tables: blocks with neighbours, block edges with node counts."""

import numpy as np
import pandas as pd
from jaxtyping import Int

from drl_meshgen.mesh import BlockMesh

SIDES = ("south", "east", "north", "west")
"""Sides of a block, anti-clockwise: j = 0, i = ni, j = nj, i = 0."""


def block_sides(grid: Int[np.ndarray, "ni1 nj1"]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the node lists of the four sides, anti-clockwise, in the order of `SIDES`."""
    return grid[:, 0], grid[-1, :], grid[::-1, -1], grid[0, ::-1]


def block_corners(mesh: BlockMesh) -> Int[np.ndarray, "b 4"]:
    """Return the corner nodes of each block: (0, 0), (ni, 0), (ni, nj), (0, nj)."""
    return np.array([[g[0, 0], g[-1, 0], g[-1, -1], g[0, -1]] for g in mesh.grids], np.int64).reshape(-1, 4)


def block_edges(mesh: BlockMesh) -> pd.DataFrame:
    """Return one row per block edge: a maximal piece of block sides with the same block (or none) across it.

    A side that faces several blocks gives several edges. Columns: `edge`, `nodes` (number of nodes, both ends
    included), `first`, `last` (end nodes, along the side of `block`), `block`, `side`, `across` (other block, -1 at the
    boundary), `across_side` ("" at the boundary), `reversed` (whether the index along the side falls across where it
    rises in `block`), `whole` (whether it is the whole side of both blocks: interfaces are 1-to-1 where all are) and
    `kind` ("interface" or "boundary"). `block` is the smaller id.
    """
    tail, head, owner, side, rank = [], [], [], [], []
    for b, grid in enumerate(mesh.grids):
        for s, nodes in enumerate(block_sides(grid)):
            tail.append(nodes[:-1])
            head.append(nodes[1:])
            owner.append(np.full(len(nodes) - 1, b))
            side.append(np.full(len(nodes) - 1, s))
            rank.append(np.arange(len(nodes) - 1))
    a, z, owner, side, rank = (np.concatenate(x) for x in (tail, head, owner, side, rank))
    step = np.arange(len(a))
    code = a * np.int64(len(mesh.points)) + z
    order = np.argsort(code, kind="stable")
    place = np.minimum(np.searchsorted(code[order], z * np.int64(len(mesh.points)) + a), len(code) - 1)
    twin = np.where(code[order][place] == z * np.int64(len(mesh.points)) + a, order[place], -1)
    across, across_side = np.where(twin >= 0, owner[twin], -1), np.where(twin >= 0, side[twin], -1)
    key = np.c_[owner, side, across, across_side]
    runs_on = (key[1:] == key[:-1]).all(axis=1) & (rank[1:] == rank[:-1] + 1)
    runs_on &= (twin[1:] < 0) | (twin[1:] == twin[:-1] - 1)
    start = np.r_[0, 1 + np.nonzero(~runs_on)[0]]
    stop = np.r_[start[1:], len(step)]
    keep = (twin[start] < 0) | (step[start] < np.minimum.reduceat(np.where(twin < 0, len(step), twin), start))
    start, stop = start[keep], stop[keep]
    names = np.array([*SIDES, ""])
    length = np.array([[g.shape[0] - 1, g.shape[1] - 1] * 2 for g in mesh.grids], np.int64)
    mine, theirs = length[owner[start], side[start]], length[across[start], across_side[start]]
    inner = across[start] >= 0
    whole = (stop - start == mine) & (~inner | (stop - start == theirs))
    return pd.DataFrame(
        {
            "edge": np.arange(len(start)),
            "nodes": stop - start + 1,
            "first": a[start],
            "last": z[stop - 1],
            "block": owner[start],
            "side": names[side[start]],
            "across": across[start],
            "across_side": names[across_side[start]],
            "reversed": inner & ((side[start] < 2) == (across_side[start] < 2)),  # south and east run with their index
            "whole": whole,
            "kind": np.where(inner, "interface", "boundary"),
        }
    )


def block_table(mesh: BlockMesh) -> pd.DataFrame:
    """Return one row per block: `block`, `ni`, `nj` (quads), corner nodes `corner0..3` and `neighbours`.

    `neighbours` lists the blocks across any of its edges, ascending, without -1.
    """
    edges = block_edges(mesh)
    block, across = edges["block"].to_numpy(), edges["across"].to_numpy()
    inner = across >= 0
    pairs = np.concatenate([np.c_[block, across][inner], np.c_[across, block][inner]])
    pairs = np.unique(pairs, axis=0)
    corners = block_corners(mesh)
    table = {
        "block": np.arange(len(mesh.grids)),
        "ni": [g.shape[0] - 1 for g in mesh.grids],
        "nj": [g.shape[1] - 1 for g in mesh.grids],
    }
    table |= {f"corner{k}": corners[:, k] for k in range(4)}
    table["neighbours"] = [pairs[pairs[:, 0] == b, 1].tolist() for b in range(len(mesh.grids))]
    return pd.DataFrame(table)
