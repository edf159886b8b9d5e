"""docs/api.md: the public names, which mkdocstrings describes from their docstrings."""

from importlib import import_module

import ibdata
from referring import NOTE

OPENING = """\
# Python

The site shows the signature and the docstring of each public name here; `help(ibdata.generate)` shows the
same in Python. Names that are not on this page may change in any version.

"""
MORE = {  # public too, beside `ibdata.__all__`
    "ibdata.testing": ("check_policy",),
    "ibdata.plots": ("plot", "figure"),
    "ibdata.report": ("card",),
    "ibdata.dataset.windows": ("Windows",),
    "ibdata.views.options": ("view_options",),
    "ibdata.dynamics": ("step", "initial_state", "Variant", "State", "Noise"),
    "ibdata.policies": ("Policy", "Deterministic", "Wrapper"),
}


def page() -> str:
    """The page."""
    parts = [NOTE + OPENING, "## ibdata\n\n`ibdata.open` is another name of `ibdata.Dataset`.\n\n"]
    parts += [_section(ibdata, name) for name in ibdata.__all__ if name not in ("__version__", "open")]
    for module, names in MORE.items():
        parts += [f"## {module}\n\n", *(_section(import_module(module), name) for name in names)]
    return "".join(parts).rstrip() + "\n"


def _section(module: object, name: str) -> str:
    found = getattr(module, name)
    inherits = getattr(found, "__mro__", (found, object))[1].__module__.startswith("ibdata.dataset")
    options = "    options:\n      inherited_members: true\n" if inherits else ""
    return f"::: {found.__module__}.{found.__qualname__}\n{options}\n"
