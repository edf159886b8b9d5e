"""The spaces of the environment; the one place besides the two classes that needs Gymnasium."""

from __future__ import annotations

import numpy as np

from ibdata.environment.settings import Settings, frame_bounds
from ibdata.errors import missing
from ibdata.policies.distributions import DISCRETE

try:
    from gymnasium.spaces import Box, Discrete
except ModuleNotFoundError:
    raise missing("ibdata.environment", "gymnasium", "gymnasium") from None


def spaces(settings: Settings) -> tuple[Box, Box | Discrete]:
    """The spaces of observations (k · history,), newest first, and of actions: (3,), or 27 discrete ones.

    The bounds hold for every setpoint, so that a policy can be used at another one.
    """
    low, high = (  # rounding is monotonic, so rounded values stay within rounded bounds
        np.tile(np.array(bounds, dtype=np.float32), settings.history) for bounds in frame_bounds(settings)
    )
    actions = Discrete(len(DISCRETE)) if settings.discrete_actions else Box(-1.0, 1.0, (3,), np.float32)
    return Box(low, high, dtype=np.float32), actions
