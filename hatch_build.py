"""What of the metadata needs the address of the repository, which pyproject.toml has in one place."""

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!https?:|#)([^)]*)\)")


class Addressed(MetadataHookInterface):
    """The links of the project, and the README with absolute links."""

    def update(self, metadata: dict) -> None:
        """Set both; without an address there are no links to the project's files."""
        address = self.config["address"].rstrip("/")
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": absolute(text, address)}
        metadata["urls"] = (
            {"Source": address, "Changelog": f"{address}/blob/HEAD/CHANGELOG.md"} if address else {}
        )


def absolute(text: str, address: str) -> str:
    """A text in which links to the project's files are absolute, or are gone where there is no address."""

    def link(found: re.Match[str]) -> str:
        mark, shown, target = found.groups()
        if not address:
            return "" if mark else shown
        return f"{mark}[{shown}]({address}/{'raw' if mark else 'blob'}/HEAD/{target})"

    return LINK.sub(link, text)
