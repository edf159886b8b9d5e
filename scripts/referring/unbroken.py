"""A hook of mkdocs: no word of inline code, such as --to or random-paper, breaks at its hyphens."""

import re
from typing import Any

CODE = re.compile(r"(?<=<code>)(?<!<pre><code>)(?<!</span><code>)[^<]+(?=</code>)")  # not in a block
HYPHENATED = re.compile(r"(?<!\S)\S{,24}-\S{,24}(?!\S)")  # longer ones would not fit a phone


def on_page_content(html: str, **_: Any) -> str:
    """The page with these words in spans, which docs/style.css keeps on one line."""
    return CODE.sub(lambda code: HYPHENATED.sub(r'<span class="unbroken">\g<0></span>', code[0]), html)
