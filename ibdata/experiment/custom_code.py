"""The custom policies of an experiment, and consent to their code."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ibdata.dataset.models import Manifest
from ibdata.errors import UsageError, printable
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.policies import Policy
from ibdata.policies.custom import Custom
from ibdata.system.storage import storage


def customs(spec: DatasetSpec) -> list[Custom]:
    """Return every custom policy, including those of which another policy is made."""
    return [found for e in spec.experiments for policy in e.policies for found in customs_in(policy)]


def customs_in(policy: Policy) -> Iterator[Custom]:
    """Yield the policy and all of which it is made, as far as they are custom."""
    return (each for each in policy.everywhere() if isinstance(each, Custom))


def require_consent(spec: DatasetSpec, where: str | Path, allow_code: bool) -> None:
    """Print on stderr which custom code will run.

    Raises UsageError if there is such code and allow_code is false, or if the code is in the script that was
    started, because it could not be imported to make the dataset again.
    """
    targets = spec.code_targets
    if targets and not allow_code:
        raise UsageError(
            f"{where}: found a custom policy, {printable(', '.join(targets))}, which is code that would run; "
            "--allow-code if you trust it"
        )
    for target in targets:
        if target.startswith("__main__:"):
            raise UsageError(
                f"{where}: found the target {target}, which is in the script itself, expected one in a "
                "module that worker processes can import; move it to a file of its own"
            )
        print(f"ibdata: running the code of {printable(target)}", file=sys.stderr, flush=True)


def consented_spec(place: Any, listed: Manifest, allow_code: bool) -> DatasetSpec:
    """Return the specification of a dataset, after `require_consent`, to make its episodes again."""
    spec = spec_in(place, listed)
    require_consent(spec, storage(place).name, allow_code)
    return spec
