"""Colours of pictures and page, and the colouring of neighbours."""

import numpy as np
from jaxtyping import Int

PASTELS = ("#a9c9e8", "#f7cfa0", "#b9dcb4", "#f3b8b4", "#cfc3e6", "#ecdf9f", "#aadcd7", "#e9c2da")
"""Fills of regions and blocks."""
DEPTH = ("#f6f2e9", "#d5e6dc", "#98cac5", "#539db0", "#2f6690", "#253a6e")
"""Depth, from the boundary to the tips."""
DEVIATION = ("#e8f1ee", "#b7dccf", "#f2d98b", "#ea9a5b", "#c8452f")
"""Largest deviation of a corner from 90 degrees, from 0 to `DEVIATION_RANGE`."""
DEVIATION_RANGE = 60.0
INK, LINE, PLAIN, CONTOUR, WORST = "#1c2430", "#66717f", "#e6ebf1", "#d9541e", "#e0452f"
VALENCE = {3: "#e4572e", 5: "#2166ac", 6: "#6a3d9a"}
"""Irregular nodes by valence; every other valence has `VALENCE_OTHER`."""
VALENCE_OTHER = "#111111"


def neighbour_colours(count: int, pairs: Int[np.ndarray, "p 2"], colours: int = len(PASTELS)) -> Int[np.ndarray, " n"]:
    """Return a colour index per item such that neighbours differ where possible, all colours used about equally."""
    around: list[set[int]] = [set() for _ in range(count)]
    for a, b in pairs.tolist():
        if a != b:
            around[a].add(b)
            around[b].add(a)
    colour = np.full(count, -1)
    used = np.zeros(colours, int)
    for item in sorted(range(count), key=lambda n: (-len(around[n]), n)):
        taken = np.zeros(colours, bool)
        taken[[colour[n] for n in around[item] if colour[n] >= 0]] = True
        choice = int(np.where(taken, np.iinfo(int).max, used).argmin())
        colour[item] = choice
        used[choice] += 1
    return colour
