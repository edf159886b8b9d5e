"""No module reads or writes pickles, because loading them runs code."""

from __future__ import annotations

import re
from pathlib import Path

import ibdata

SOURCES = {path: path.read_text(encoding="utf-8") for path in Path(ibdata.__file__).parent.rglob("*.py")}
FORBIDDEN = re.compile(
    r"\b(pickle|cPickle|dill|cloudpickle|joblib|marshal|shelve)\b|allow_pickle=True|\beval\(|\bexec\("
)


def test_no_module_names_pickle_or_evaluates_text():
    assert len(SOURCES) > 90
    found = {path.name: match[0] for path, text in SOURCES.items() if (match := FORBIDDEN.search(text))}
    assert found == {}
