"""The simulation behind the environment of one lane, of which a step takes a few microseconds."""

from __future__ import annotations

from struct import unpack

import numpy as np

from ibdata.environment.settings import Settings
from ibdata.environment.simulation import Float32s, Simulation
from ibdata.numerics.philox import Raw
from ibdata.policies import OBSERVATION
from ibdata.policies.actions import Action, applied
from ibdata.simulation import kernel
from ibdata.simulation.noise import DRIFT_SLOTS, DYNAMICS_SLOTS
from ibdata.simulation.variables import hidden, record_rows
from ibdata.variables import VARIABLES

DRAWN = (*OBSERVATION, "mu_v", "mu_g", "direction")


class Lane(Simulation):
    """One lane. A call of NumPy takes as long as half the equations, so there are few."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings, 1)
        drifting, view = settings.world.drifting, settings.view
        self.draws = DYNAMICS_SLOTS + DRIFT_SLOTS * drifting  # random integers of a step
        self._parameters = settings.world.parameters
        self._plain = view.is_classic and view.reward.kind == "classic" and view.reward_scale == 1
        wanted = (*hidden(drifting), "reward")
        self._rows, self._out = record_rows(wanted), np.zeros(len(wanted))
        self._form = "".join("q" if VARIABLES[name].whole else "d" for name in wanted)

    def move(self, action: Action, raw: Raw) -> tuple[Float32s, float, dict[str, float]]:
        """Make a step; return observation, scaled reward, and hidden variables by column name."""
        (floats, integers), (dv, dg, dh) = self._state, action
        before = None if self._plain else self._costs(self.seen)
        kernel.simulate_lane(
            floats, integers, dv, dg, dh, raw, self._parameters, self.seen, self._rows, self._out
        )
        numbers = unpack(self._form, self._out)  # type: ignore[arg-type]  # an array is a buffer
        info = dict(zip(self._latent, numbers))  # noqa: B905  # the reward is left over
        if self._plain:
            return self.seen.ravel().copy(), numbers[-1], info
        if self._window is not None:
            true = self._true_values()
            self._window.push(self.everyone, true, applied([action]))
            info |= {name: true[0, i].item() for name, i in self._clean.items()}
        [reward] = self._rewards(self._state, before, self._costs(self.seen)).tolist()
        return self.observations()[0], reward, info

    def drawn(self) -> dict[str, float]:
        """The variables that a picture of an episode shows."""
        return {name: getattr(self._state, name)[0].item() for name in DRAWN}
