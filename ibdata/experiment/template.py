"""The experiment that `ibdata init` writes: a small one, with every option and its values."""

from __future__ import annotations

import os

from pydantic import TypeAdapter, ValidationError

from ibdata._numerics.naming import yaml_name
from ibdata._system.storage import local
from ibdata.errors import IbdataError, UsageError
from ibdata.experiment.fields import FileName

TEXT = """\
# An experiment of ibdata, which determines the contents of a dataset.
name: {name}

# siemens: the authors' code, with which nearly all published results were made.
# paper: the equations as printed. A variant with single fields replaced: {{base: siemens, eta_mean: 0.05}}
dynamics: siemens

# In [0, 100]: a number, a list, a range that includes its stop, or moving: drifting, {{drifting: [10, 50]}}
setpoints: {{start: 10, stop: 100, step: 10}}

# Each policy is combined with each setpoint; `ibdata config policies` lists them with their options.
policies:
  - kind: random
  - kind: epsilon_greedy
    base: {{kind: optimized}}
    epsilon: 0.4
    name: explored              # label in the data; by default the kind

episodes: 2                     # of each setpoint and policy
steps: 1000                     # rows of an episode

# default: velocity = gain = shift = 50; uniform: anywhere; {{burn_in: [15, 64]}}: random steps first
start: default
seed: 0

output:
  dtype: float32                # or float64
  latent: true                  # the hidden state; or false, full (with derived values), next (also at t + 1)

# Named sets of episodes, stored in files of their own: by setpoint, policy, and episodes of each combination.
splits:
  source: {{setpoint: 50}}
  target: {{setpoint: 70, episodes: 1}}

licence: CC-BY-4.0              # of the dataset, an SPDX expression
"""


def template(name: str) -> str:
    """The text of the experiment with this name."""
    return TEXT.format(name=yaml_name(name))


def write_template(file: str | os.PathLike[str]) -> None:
    """Write the template into a new file and name the experiment after the file.

    Raises UsageError if the file exists, and IbdataError if it cannot be written.
    """
    path = local(file)
    try:
        name = TypeAdapter(FileName).validate_python(path.stem)
    except ValidationError:
        name = "experiment"
    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(template(name))
    except FileExistsError:
        raise UsageError(f"{path}: exists already; choose another name") from None
    except OSError as error:
        raise IbdataError(f"{path}: cannot be written: {error.strerror}") from None
