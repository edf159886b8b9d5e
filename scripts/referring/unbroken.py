"""A hook of mkdocs: words of inline code, such as --to, break at slashes and not at hyphens."""

import re
from typing import Any

CODE = re.compile(r"(?<=<code>)(?<!<pre><code>)(?<!</span><code>)[^<]+(?=</code>)")  # not in a block
HYPHENATED = re.compile(r"(?<!\S)\S{,24}-\S{,24}(?!\S)")  # longer ones would not fit a phone
SLASH = re.compile(r"(?<=\w)/(?=\w)")


def on_page_content(html: str, **_: Any) -> str:
    """The page with breaks after slashes, and hyphens in spans, which docs/style.css keeps on one line."""
    return CODE.sub(lambda code: SLASH.sub("/<wbr>", HYPHENATED.sub(_span, code[0])), html)


def _span(word: re.Match[str]) -> str:
    return f'<span class="unbroken">{word[0]}</span>'
