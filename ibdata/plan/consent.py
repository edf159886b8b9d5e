"""Consent to the code of custom policies, before it runs."""

from __future__ import annotations

from pathlib import Path

from ibdata.dataset.stored import Stored
from ibdata.errors import ALLOW_CODE, UsageError, printable
from ibdata.plan.dataset_spec import DatasetSpec, spec_in
from ibdata.policies.code import refuse_within_itself


def require_consent(spec: DatasetSpec, where: str | Path, allow_code: bool, again: bool = False) -> None:
    """Refuse custom policies without consent. Messages begin with `where`.

    Raises UsageError if the code may not run, or if a policy is a live object that no longer exists. With
    `again`, other processes may need the policy, so every live object is refused.
    """
    targets = list(dict.fromkeys(custom.target for custom in spec.custom))
    if targets and not allow_code:
        raise UsageError(
            f"{where}: found a custom policy, {printable(', '.join(targets))}, which is code that would run; "
            f"{ALLOW_CODE} if you trust it"
        )
    refuse_within_itself(targets)
    for user_object in spec.live:
        if again or not user_object.is_here:
            raise UsageError(
                f"{where}: found {user_object.code_target}, an object that acts in the Python session of its "
                "run and nowhere else; put its class into a file and name it with kind: custom"
            )


def consented_spec(stored: Stored, allow_code: bool) -> DatasetSpec:
    """Read the specification of a dataset whose episodes are made again, after `require_consent`."""
    spec = spec_in(stored)
    require_consent(spec, stored.name, allow_code, again=True)
    return spec
