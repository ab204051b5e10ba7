"""Policies by the names that users know them by."""

from collections.abc import Callable
from typing import Final

from drl_meshgen.errors import InputError
from drl_meshgen.templates.policy import Policy, RulePolicy

POLICIES: Final[dict[str, Callable[[], Policy]]] = {"rule": RulePolicy}
"""How each policy is set up, by its name."""


def policy_named(name: str) -> Policy:
    """Return the policy of that name; raises `InputError` for a name that is none."""
    if name not in POLICIES:
        raise InputError("policy", f"{name!r} is not known", f"take one of {', '.join(POLICIES)}")
    return POLICIES[name]()
