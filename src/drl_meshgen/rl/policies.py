"""Policies by the names that users know them by. Heavy packages are imported only by the policies that need them."""

from pathlib import Path
from typing import Final

from drl_meshgen.errors import InputError
from drl_meshgen.store.canonical import file_digest
from drl_meshgen.templates.policy import RulePolicy, TemplatePolicy

AGENT: Final = "agent"
POLICIES: Final = (AGENT, "rule", "optimizer")
"""The learned policy that comes with the package, rules, and gradient ascent."""
SUFFIX: Final = ".safetensors"
SHIPPED: Final = Path(__file__).parent / "weights" / "agent.safetensors"
"""Weights of the learned policy."""


def policy_named(name: str) -> TemplatePolicy:
    """Return the policy of that name, or of a policy file; raises `InputError` for what is neither."""
    if name == "rule":
        return RulePolicy()
    if name == "optimizer":
        from drl_meshgen.rl.optimum import OptimizerPolicy

        return OptimizerPolicy()
    if name == AGENT or name.endswith(SUFFIX):
        from drl_meshgen.rl.policy_file import read_policy

        return read_policy(SHIPPED if name == AGENT else name)
    raise InputError(
        "policy", f"policy {name!r} is not known", f"take one of {', '.join(POLICIES)}, or a {SUFFIX} file"
    )


def policy_identity(name: str) -> str:
    """Return what tells policies apart: the name, for learned ones the digest of the weights.

    Raises OSError where a policy file cannot be read.
    """
    if name == AGENT or name.endswith(SUFFIX):
        return file_digest(SHIPPED if name == AGENT else Path(name))
    return name
