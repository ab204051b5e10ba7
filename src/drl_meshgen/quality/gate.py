"""The quality gate: what a mesh must meet to be called good enough."""

from dataclasses import dataclass

from drl_meshgen.quality.metrics import Quality


@dataclass(frozen=True)
class GateOptions:
    """Limits of the gate."""

    min_validity: float = 1.0
    """Least share of quads with four positive Jacobians, 0..1."""
    min_angle: float = 5.0
    """Every corner angle must be larger, degrees."""
    max_angle: float = 175.0
    """Every corner angle must be smaller, degrees."""


def gate(quality: Quality, options: GateOptions | None = None) -> tuple[str, ...]:
    """Return the criteria that the mesh fails, one sentence each; empty when it passes."""
    options = options or GateOptions()
    m = quality.metrics
    failed = list(quality.defects)
    if m["validity"] < options.min_validity:
        failed.append(f"validity {m['validity']:.2%} is below {options.min_validity:.2%}")
    if not m["min_angle"] > options.min_angle:
        failed.append(f"minimum angle {m['min_angle']:.2f} is not above {options.min_angle:g} degrees")
    if not m["max_angle"] < options.max_angle:
        failed.append(f"maximum angle {m['max_angle']:.2f} is not below {options.max_angle:g} degrees")
    return tuple(failed)
