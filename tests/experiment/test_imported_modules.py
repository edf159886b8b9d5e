"""The imports of a module, as found in its source."""

from __future__ import annotations

import sys

import pytest

from ibdata.experiment.imported_modules import imported

TREE = {
    "top.py": "import json, helper\nfrom package import inner, name\nfrom package.sub.deep import *\n"
    "try:\n    import absent\nexcept ImportError:\n    pass\ndef later():\n    import lazy.module\n",
    "helper.py": "import helper, top\nimport numpy.linalg as linalg\n",
    "package/__init__.py": "name = 1",
    "package/inner.py": "from . import sibling\nfrom .sub import deep\nfrom .... import beyond",
    "package/sibling.py": "this is no Python",
    "package/unused.py": "",
    "package/sub/__init__.py": "",
    "package/sub/deep.py": "from ..sibling import name\nimport ibdata",
    "lazy/module.py": "raise RuntimeError('it ran')",
}


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """A folder of modules on the path."""
    for path, text in TREE.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def test_every_own_module_is_found_and_none_is_imported(tree):
    sources, others = imported("top")
    assert set(sources) == set(TREE) - {"package/unused.py"}
    assert next(iter(sources)) == "top.py"
    assert {name: source.path for name, source in sources.items()} == {name: tree / name for name in sources}
    assert sources["lazy/module.py"].module == "lazy.module"
    assert others == {"numpy", "ibdata", "absent"}
    assert not {source.module for source in sources.values()} & set(sys.modules)


def test_of_an_installed_module_its_own_package_is_followed(tree, monkeypatch):
    site = tree / "site-packages"
    for path, text in TREE.items():
        (site / path).parent.mkdir(parents=True, exist_ok=True)
        (site / path).write_text(text)
        (tree / path).unlink()
    monkeypatch.syspath_prepend(site)
    sources, others = imported("package.inner")
    assert set(sources) == {path for path in TREE if path.startswith("package/")} - {"package/unused.py"}
    assert imported("helper")[0].keys() == {"helper.py"}
    assert imported("helper")[1] == {"numpy", "top"}
    assert others == {"ibdata"}


def test_a_nested_folder_without_init_is_a_package_too(tree):
    (tree / "a/b").mkdir(parents=True)
    (tree / "a/b/c.py").write_text("from .d import x\nfrom . import e")
    for name in "de":
        (tree / f"a/b/{name}.py").write_text("")
    assert imported("a.b.c")[0].keys() == {"a/b/c.py", "a/b/d.py", "a/b/e.py"}


@pytest.mark.parametrize("module", ["absent", "package.absent", "top.later"])
def test_what_is_no_module_has_no_file(tree, module):
    assert module not in [source.module for source in imported(module)[0].values()]
