"""The licences of a dataset in the front matter of its card, in the words of the Hugging Face Hub."""

from __future__ import annotations

from collections.abc import Sequence

OTHER = "other"
# Licences for data and code that the Hub knows by their SPDX names in lower case.
SAME = """
apache-2.0 bsd-2-clause bsd-3-clause cc0-1.0 cc-by-2.0 cc-by-2.5 cc-by-3.0 cc-by-4.0 cc-by-sa-3.0 cc-by-sa-4.0
cc-by-nc-2.0 cc-by-nc-3.0 cc-by-nc-4.0 cc-by-nd-4.0 cc-by-nc-nd-3.0 cc-by-nc-nd-4.0 cc-by-nc-sa-2.0
cc-by-nc-sa-3.0 cc-by-nc-sa-4.0 cdla-permissive-1.0 cdla-permissive-2.0 cdla-sharing-1.0 etalab-2.0 isc mit
mpl-2.0 unlicense zlib
"""
FAMILIES = {"odbl-1.0": "odbl", "odc-by-1.0": "odc-by", "pddl-1.0": "pddl"}  # which it knows without a number


def front_matter(licences: Sequence[str]) -> list[str]:
    """The lines of the front matter for these SPDX expressions, of which there is at least one.

    https://huggingface.co/docs/hub/repositories-licenses lists the words; any other licence is `other`.

    >>> front_matter(["CC-BY-4.0"])
    ['license: cc-by-4.0']
    >>> front_matter(["ODbL-1.0", "MIT OR Apache-2.0"])
    ['license: [odbl, other]', 'license_name: "MIT OR Apache-2.0"']
    """
    words = {licence: _word(licence) for licence in licences}
    found = list(dict.fromkeys(words.values()))
    others = ", ".join(licence for licence, word in words.items() if word == OTHER)
    lines = [f"license: {found[0] if len(found) == 1 else '[' + ', '.join(found) + ']'}"]
    return [*lines, f'license_name: "{others}"'] if others else lines


def _word(licence: str) -> str:
    lower = licence.lower()
    return lower if lower in SAME.split() else FAMILIES.get(lower, OTHER)
