"""Code that a config names: it runs only where that was allowed, and what ran is recorded."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ibdata.errors import UsageError, printable
from ibdata.experiment.recipe import Recipe, recipe_in


def targets(recipe: Recipe) -> list[str]:
    """The `package.module:name` of every custom policy, also of those inside others."""
    found = (t for e in recipe.experiments for policy in e.plain()["policies"] for t in block_targets(policy))
    return list(dict.fromkeys(found))


def block_targets(block: dict[str, Any]) -> Iterator[str]:
    """The targets in a policy's block."""
    if block["kind"] == "custom":
        yield block["target"]
    if isinstance(block.get("base"), dict):
        yield from block_targets(block["base"])


def refuse_code(recipe: Recipe, where: str | Path, allow_code: bool) -> None:
    """Raises UsageError where a policy is code and that is not allowed; else says on stderr what will run."""
    found = targets(recipe)
    if found and not allow_code:
        raise UsageError(
            f"{where}: found a custom policy, {printable(', '.join(found))}, which is code that would run; "
            "--allow-code (allow_code=True) if you trust it"
        )
    for target in found:
        print(f"ibdata: running the code of {printable(target)}", file=sys.stderr, flush=True)


def recipe_of(folder: Path, listed: dict[str, Any], allow_code: bool) -> Recipe:
    """As `recipe_in`, for making episodes again. Raises as that, and as `refuse_code`."""
    recipe = recipe_in(folder, listed)
    refuse_code(recipe, folder, allow_code)
    return recipe


def provenance(recipe: Recipe) -> list[dict[str, str | None]]:
    """Target, version of its distribution and SHA-256 of its source file, for each custom policy."""
    return [_provenance(target) for target in targets(recipe)]


def _provenance(target: str) -> dict[str, str | None]:
    module = target.partition(":")[0]
    spec = importlib.util.find_spec(module)
    source = Path(spec.origin) if spec and spec.origin else None
    owners = importlib.metadata.packages_distributions().get(module.split(".")[0], [])
    return {
        "target": target,
        "version": importlib.metadata.version(owners[0]) if owners else None,
        "sha256": hashlib.sha256(source.read_bytes()).hexdigest() if source and source.is_file() else None,
    }
