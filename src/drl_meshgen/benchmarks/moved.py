"""What moved between two benchmark runs, metric by metric."""

from enum import Enum

import numpy as np
import pandas as pd

from drl_meshgen.benchmarks.columns import FIGURES, RANKED

VERDICTS = ("failed", "below gate", "passed")
"""Values of the column `verdict`, from the worst to the best."""
COLUMNS = ("surface", "metric", "before", "after", "movement")


class Movement(Enum):
    """What became of a metric of a surface."""

    WORSE = "worse"
    BETTER = "better"
    NEW = "new"
    MISSING = "missing"


def moved(before: pd.DataFrame, after: pd.DataFrame, tolerance: float = 0.01) -> pd.DataFrame:
    """Return what differs between two tables with a row per surface: the columns `COLUMNS`, the worst movements first.

    Both have the columns `surface`, `verdict` (one of `VERDICTS`) and metrics. Counts and verdicts are compared
    exactly; other figures may differ by `tolerance` (share of the former figure) and by one unit of the last digit
    that tables show. Surfaces that only one table has are one row, `new` or `missing`, of the metric `verdict`.
    Values are text, as they are shown. Raises ValueError for an unknown verdict.
    """
    old, new = (table.set_index("surface") for table in (before, after))
    rows = []
    for name in [*new.index, *(one for one in old.index if one not in new.index)]:
        if name not in old.index:
            rows.append((name, "verdict", "", new.loc[name, "verdict"], Movement.NEW))
        elif name not in new.index:
            rows.append((name, "verdict", old.loc[name, "verdict"], "", Movement.MISSING))
        else:
            rows += _of_surface(str(name), old.loc[name].to_dict(), new.loc[name].to_dict(), tolerance)
    order = list(Movement)
    rows.sort(key=lambda row: order.index(row[-1]))
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    return table.assign(movement=[row[-1].value for row in rows])


def _of_surface(name: str, old: dict, new: dict, tolerance: float) -> list[tuple[str, str, str, str, Movement]]:
    rows = []
    ranks = VERDICTS.index(old["verdict"]), VERDICTS.index(new["verdict"])
    if ranks[0] != ranks[1]:
        movement = Movement.BETTER if ranks[1] > ranks[0] else Movement.WORSE
        rows.append((name, "verdict", old["verdict"], new["verdict"], movement))
    for metric in RANKED:
        figure = FIGURES[metric]
        was, now = float(old.get(metric, np.nan)), float(new.get(metric, np.nan))
        if not (np.isfinite(was) and np.isfinite(now)):
            continue  # without a mesh before or now, which is what the verdict says
        slack = max(10.0**-figure.digits, tolerance * abs(was)) if figure.digits else 0.0
        if abs(now - was) <= slack:
            continue
        movement = Movement.BETTER if (now > was) == bool(figure.more_is_better) else Movement.WORSE
        rows.append((name, metric, f"{was:.{figure.digits}f}", f"{now:.{figure.digits}f}", movement))
    return rows
