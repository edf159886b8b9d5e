"""The simulation behind the environment of one lane, of which a step takes a few microseconds."""

from __future__ import annotations

import numpy as np

from ibdata.dynamics.noise import DRIFT_SLOTS, DYNAMICS_SLOTS
from ibdata.environment.settings import Settings
from ibdata.environment.simulation import Float32s, Simulation
from ibdata.numerics.philox import Raw
from ibdata.policies import OBSERVATION
from ibdata.policies.actions import Action, applied
from ibdata.simulation import kernel
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
        self._whole = [column for column, name in self._latent.items() if VARIABLES[name].whole]

    def move(self, action: Action, raw: Raw) -> tuple[Float32s, float, dict[str, float]]:
        """Make a step; return observation, scaled reward, and hidden variables by column name."""
        carry, (dv, dg, dh) = self.carry, action
        before = None if self._plain else self._costs(carry)
        kernel.simulate_lane(
            carry.state.values, dv, dg, dh, raw, self._parameters, carry.observations, self._rows, self._out
        )
        *hidden, classic = self._out.tolist()
        info = dict(zip(self._latent, hidden, strict=True))
        for column in self._whole:
            info[column] = int(info[column])
        if self._plain:
            return carry.observations.ravel().copy(), classic, info
        if self._window is not None:
            true = self._true_values()
            self._window.push(self.everyone, true, applied([action]))
            info |= {name: true[0, i].item() for name, i in self._clean.items()}
        [reward] = self._rewards(carry.state.reward, before, self._costs(carry)).tolist()
        return self.observations()[0], reward, info

    def drawn(self) -> dict[str, float]:
        """The variables that a picture of an episode shows."""
        return {name: getattr(self.carry.state, name)[0].item() for name in DRAWN}
