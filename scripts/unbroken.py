"""A hook of mkdocs: options such as --to, and words of inline code, break at slashes and not at hyphens."""

import re
from typing import Any

CODE = re.compile(r"(<pre[^>]*>(?:<span></span>)?)?(<code[^>]*>)(.*?)(?=</code>)", re.DOTALL)
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*")
HYPHENATED = re.compile(r"(?<!\S)\S{,24}-\S{,24}(?!\S)")  # longer ones would not fit a phone
SLASH = re.compile(r"(?<=\w)/(?=\w)")


def on_page_content(html: str, **_: Any) -> str:
    """The page with breaks after slashes, and hyphens in spans, which docs/style.css keeps on one line."""
    return CODE.sub(_mended, html)


def _mended(code: re.Match[str]) -> str:
    block, opening, text = code[1] or "", code[2], code[3]
    span = r'<span class="unbroken">\g<0></span>'
    if block or "<" in text:
        return block + opening + OPTION.sub(span, text)
    return opening + SLASH.sub("/<wbr>", HYPHENATED.sub(span, text))
