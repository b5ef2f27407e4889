"""Makes the policy of a run, by name or as an object."""

from __future__ import annotations

from typing import Any

from gazempc.part_options import make, options_for
from gazempc.parts import BY_NAME, POLICY, check_methods
from gazempc.people.company import AttentionPolicy
from gazempc.people.policies import Named


def make_policy(choice: str | AttentionPolicy, options: dict[str, Any]) -> AttentionPolicy:
    """Make a policy.

    Args:
        choice: A shipped name, ``id:NAME``, ``module:Class``, or a policy.
        options: Parameters of your own one.

    Returns:
        The policy.

    Raises:
        SettingsError: If it cannot be made, or lacks a method.
    """
    if not isinstance(choice, str):
        check_methods(POLICY, choice)
        return choice
    if choice.startswith(BY_NAME):
        return Named(choice.removeprefix(BY_NAME))
    policy: AttentionPolicy = make(POLICY, choice, {}, options_for(POLICY, choice, options))
    return policy
