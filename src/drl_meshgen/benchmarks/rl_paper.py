"""What the paper prints in its Tables 1 to 4, to stand beside ours; measured by its authors on their own sets."""

from typing import Final

Printed = dict[str, str]

TABLE_1: Final[dict[str, Printed]] = {
    "quality": {
        "boundary_error": "0.89 ± 0.12",
        "orthogonality": "0.91 ± 0.02",
        "validity": "100.0 ± 0.0 %",
        "reward": "0.67",
    },
    "fitting": {
        "boundary_error": "0.15 ± 0.03",
        "orthogonality": "0.45 ± 0.08",
        "validity": "62.3 ± 8.7 %",
        "reward": "0.41",
    },
    "full": {
        "boundary_error": "0.28 ± 0.04",
        "orthogonality": "0.87 ± 0.03",
        "validity": "100.0 ± 0.0 %",
        "reward": "0.86",
    },
}
"""Configuration -> metric -> figure; the paper calls the last column a comprehensive score."""
_TABLE_2 = {
    "early": ("0.62", "42 %", "1.48", "47 %", "0.003"),
    "late": ("0.87", "89 %", "1.13", "100 %", "0.66"),
}
TABLE_2: Final[dict[str, Printed]] = {
    key: dict(zip(("orthogonality", "compliance", "edge_ratio", "validity", "reward"), figures, strict=True))
    for key, figures in _TABLE_2.items()
}
"""Stage -> metric -> figure."""
_TABLE_3 = {
    ("test-standard", "ours"): ("0.88 ± 0.05", "0.93 ± 0.04", "0.86 ± 0.06", "0.97 ± 0.02", "25.7 ms"),
    ("test-standard", "SQP"): ("0.87 ± 0.08", "0.91 ± 0.06", "0.84 ± 0.07", "0.95 ± 0.04", "35.6 s"),
    ("test-standard", "GA"): ("0.86 ± 0.07", "0.92 ± 0.05", "0.85 ± 0.06", "0.96 ± 0.03", "174.3 s"),
    ("test-hard", "ours"): ("0.84 ± 0.06", "0.89 ± 0.05", "0.82 ± 0.07", "0.94 ± 0.03", "25.7 ms"),
    ("test-hard", "SQP"): ("0.77 ± 0.13", "0.81 ± 0.12", "0.74 ± 0.14", "0.88 ± 0.09", "51.2 s"),
    ("test-hard", "GA"): ("0.80 ± 0.11", "0.85 ± 0.08", "0.78 ± 0.10", "0.90 ± 0.07", "243.8 s"),
}
TABLE_3: Final[dict[tuple[str, str], Printed]] = {
    key: dict(zip(("orthogonality", "smoothness", "jacobian_ratio", "boundary_fit", "ms"), figures, strict=True))
    for key, figures in _TABLE_3.items()
}
"""Set and method -> metric -> figure."""
_TABLE_4 = {
    ("test-standard", "ours"): ("0.88 ± 0.05", "0.93 ± 0.04", "0.86 ± 0.06", "100 %", "25.7 ms"),
    ("test-standard", "Gmsh quasi-structured"): ("0.85 ± 0.07", "0.94 ± 0.03", "0.88 ± 0.05", "100 %", "45.3 ms"),
    ("test-hard", "ours"): ("0.84 ± 0.06", "0.89 ± 0.05", "0.82 ± 0.07", "100 %", "25.7 ms"),
    ("test-hard", "Gmsh quasi-structured"): ("0.79 ± 0.11", "0.86 ± 0.09", "0.83 ± 0.08", "100 %", "48.1 ms"),
}
TABLE_4: Final[dict[tuple[str, str], Printed]] = {
    key: dict(zip(("orthogonality", "smoothness", "jacobian_ratio", "validity", "ms"), figures, strict=True))
    for key, figures in _TABLE_4.items()
}
"""Set and method -> metric -> figure."""
