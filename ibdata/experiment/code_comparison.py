"""Compare the code of custom policies with that which a record holds."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ibdata.dataset.models import Code
from ibdata.errors import UsageError, printable
from ibdata.experiment.code_record import AS_IMPORTED


def refuse_changed(began: Iterable[Code], here: Iterable[Code], where: str | Path) -> None:
    """Raise UsageError if code, or a declared file, is not that with which a dataset was made.

    Here may be fewer policies than in the dataset, beside others that have imported modules, too.
    """
    began, here = list(began), list(here)
    was, found = code_hashes(began), code_hashes(here)
    changed = {name for name in was.keys() & found.keys() if was[name] != found[name]}
    for code in here:  # modules that appeared, or vanished
        names = [_names(other) for other in began if other.target == code.target]
        if names and _names(code) not in names:
            changed |= _names(code) ^ names[0]
    if changed:
        raise UsageError(
            f"{where}: found other code than the dataset was made with, in {listed(changed)}; restore it, "
            "and give a changed policy a file of its own"
        )


def code_hashes(code: Iterable[Code]) -> dict[str, str | None]:
    """The hashes of modules and of declared files, by the names that messages give them."""
    found: dict[str, str | None] = {}
    for each in code:
        for name, sha256 in {each.target: each.sha256, **each.files}.items():
            before = found.setdefault(name, sha256)
            if before != sha256:  # two files of policies that find them in different folders
                found[name] = f"{before} {sha256}"
    return found


def listed(names: Iterable[str]) -> str:
    """Names of files in a record, for a message."""
    return printable(", ".join(sorted({name.removesuffix(AS_IMPORTED) for name in names})[:8]))


def _names(code: Code) -> set[str]:
    """The names of files that are known without an import."""
    return {name for name in code.files if not name.endswith(AS_IMPORTED)}
