"""docs/api.md: the public names, which mkdocstrings describes from their docstrings."""

from importlib import import_module

import ibdata

PUBLIC = {
    "ibdata": [name for name in ibdata.__all__ if name not in ("__version__", "open")],
    "ibdata.testing": ["check_policy"],
    "ibdata.plots": ["plot", "figure"],
    "ibdata.report": ["card"],
    "ibdata.dataset.windows": ["Windows"],
    "ibdata.views.options": ["view_options"],
    "ibdata.dynamics": ["step", "initial_state", "Variant", "State", "Noise"],
    "ibdata.policies": ["Policy", "Needs", "Observed", "Decision", "Deterministic", "Wrapper"],
}


def block() -> str:
    """A section for each module with public names."""
    return "\n\n".join(
        "\n\n".join([f"## {module}", *(_directive(module, name) for name in names)])
        for module, names in PUBLIC.items()
    )


def _directive(module: str, name: str) -> str:
    found = getattr(import_module(module), name)
    inherits = getattr(found, "__mro__", (found, object))[1].__module__.startswith("ibdata.dataset")
    options = "\n    options:\n      inherited_members: true" if inherits else ""
    return f"::: {found.__module__}.{found.__qualname__}{options}"
