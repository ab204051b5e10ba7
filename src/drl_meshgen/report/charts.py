"""Charts as inline SVG, coloured by the page's style sheet (`s0`, `s1`, ... are the series)."""

from collections.abc import Sequence

import numpy as np

from drl_meshgen.report.tables import HISTOGRAM_STEP, Row

_WIDTH, _HEIGHT, _LEFT, _RIGHT, _BOTTOM, _TOP = 720, 260, 44, 18, 34, 12


def angle_chart(histogram: Sequence[Row], methods: Sequence[str]) -> str:
    """Return the share of corners by angle, first method filled, the others as lines, from one model's bins."""
    wide, high = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    top = max(0.05, max(float(row["share"]) for row in histogram) * 1.05)

    def x(angle: float) -> float:
        return round(_LEFT + wide * angle / 180, 1)

    def y(share: float) -> float:
        return round(_TOP + high * (1 - share / top), 1)

    parts = [f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="Corner angles">']
    for share in np.arange(0, top, 0.1 if top > 0.25 else 0.05).tolist():
        level = y(share)
        parts.append(f'<line class="grid" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{level}" y2="{level}"/>')
        parts.append(f'<text class="tick" x="{_LEFT - 8}" y="{level + 4}" text-anchor="end">{100 * share:.0f}%</text>')
    parts += [
        f'<text class="tick" x="{x(angle)}" y="{_HEIGHT - 12}" text-anchor="middle">{angle}°</text>'
        for angle in range(0, 181, 30)
    ]
    parts.append(f'<line class="ideal" x1="{x(90)}" x2="{x(90)}" y1="{_TOP}" y2="{y(0)}"/>')
    for k, method in reversed(list(enumerate(methods))):
        points = [
            f"{x(row['from'] + side * HISTOGRAM_STEP)},{y(row['share'])}"
            for row in histogram
            if row["method"] == method
            for side in (0, 1)
        ]
        if not points:
            continue
        if k == 0:
            parts.append(f'<polygon class="area s0" points="{x(0)},{y(0)} {" ".join(points)} {x(180)},{y(0)}"/>')
        parts.append(f'<polyline class="curve s{k}" points="{" ".join(points)}"/>')
    parts.append("</svg>")
    return "\n".join(parts)
