"""Policy search through an ensemble of learned models, with a penalty for leaving the behaviour.

The models predict the changes of fatigue and consumption from the last ten observations and the setpoint,
velocity, gain and shift to which the action leads, as in studies/world-models. A policy is then improved by
the gradient of what it gets in 30 imagined steps, which begin in observations of the dataset: the discounted
rewards of the model that promises least, less the mean squared distance of the action from that of a policy
learned by behavioural cloning. This is a simple form of LION (Swazinna et al., 2022), of one fixed weight.
"""

from __future__ import annotations

import copy
import itertools
import time
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ibdata.dynamics.setpoint import D_G, D_H, D_V
from training.offline import (
    BATCH,
    DISCOUNT,
    FINE_TUNING,
    HIDDEN,
    HISTORY,
    REWARD_SCALE,
    Rows,
    seen_spread,
    spent,
    versions,
)

MEMBERS, FRAMES, MODEL_STEPS, MODEL_RATE = 4, 10, 15_000, 1e-3
CLONING_STEPS, POLICY_STEPS, POLICY_RATE, HORIZON, PENALTY = 10_000, 1_000, 1e-3, 30, 3.0
VARIABLES, PREDICTED = 6, slice(4, 6)  # of an observation: fatigue and consumption come last

HYPERPARAMETERS = {
    "history": HISTORY,
    "reward_scale": REWARD_SCALE,
    "hidden_units": list(HIDDEN),
    "gamma": DISCOUNT,
    "batch_size": BATCH,
    "members": MEMBERS,
    "model_history": FRAMES,
    "model_steps": MODEL_STEPS,
    "model_learning_rate": MODEL_RATE,
    "cloning_steps": CLONING_STEPS,
    "policy_learning_rate": POLICY_RATE,
    "horizon": HORIZON,
    "penalty": PENALTY,
}


class Members(nn.Module):
    """Networks of one shape, evaluated together, from (members, n, inputs) to (members, n, outputs)."""

    def __init__(self, members: int, *sizes: int) -> None:
        super().__init__()
        shapes = list(itertools.pairwise(sizes))
        self.weights = nn.ParameterList(
            torch.randn(members, inputs, outputs) / inputs**0.5 for inputs, outputs in shapes
        )
        self.biases = nn.ParameterList(torch.zeros(members, 1, outputs) for _, outputs in shapes)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs of all members."""
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(bias, torch.relu(x) if layer else x, weight)
        return x


class Models(nn.Module):
    """The ensemble: fatigue and consumption (members, n, 2) after observations (n, 6 · history)."""

    def __init__(self, rows: Rows) -> None:
        super().__init__()
        self.lowest, self.highest = torch.full((2,), torch.inf), torch.full((2,), -torch.inf)
        self.look_at(rows)
        sample = self.at[torch.randperm(len(self.at))[:50_000]]
        inputs, changes = self.inputs(self.observations[sample], self.actions[sample]), self.changes(sample)
        self.center, self.spread = inputs.mean(dim=0), spread_of(inputs.std(dim=0))
        self.mean, self.scale = changes.mean(dim=0), changes.std(dim=0)
        self.members = Members(MEMBERS, inputs.shape[1], *HIDDEN, 2)

    def look_at(self, rows: Rows) -> None:
        """Learn from these rows from now on."""
        self.observations, self.actions = torch.from_numpy(rows.observations), torch.from_numpy(rows.actions)
        self.at = torch.from_numpy(rows.transitions)
        known = self.observations[self.at, PREDICTED]
        self.lowest = torch.minimum(self.lowest, known.amin(dim=0))
        self.highest = torch.maximum(self.highest, known.amax(dim=0))

    def drawn(self, rows: int) -> Tensor:
        """So many rows of the data that are transitions, with replacement."""
        return self.at[torch.randint(len(self.at), (rows,))]

    def inputs(self, seen: Tensor, actions: Tensor) -> Tensor:
        """What the networks see (n, 64)."""
        return torch.cat([seen[:, : VARIABLES * FRAMES], steered(seen, actions)], dim=1)

    def changes(self, at: Tensor) -> Tensor:
        """How fatigue and consumption changed (n, 2) after these rows of the data."""
        return self.observations[at + 1, PREDICTED] - self.observations[at, PREDICTED]

    def fit(self, steps: int = MODEL_STEPS) -> None:
        """Train each member on its own draws from the data."""
        self.requires_grad_(True)
        optimizer = torch.optim.Adam(self.members.parameters(), lr=MODEL_RATE)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        for _ in range(steps):
            at = self.drawn(MEMBERS * BATCH)
            x = (self.inputs(self.observations[at], self.actions[at]) - self.center) / self.spread
            y = (self.changes(at) - self.mean) / self.scale
            predicted = self.members(x.view(MEMBERS, BATCH, -1))
            descend(optimizer, ((predicted - y.view(MEMBERS, BATCH, -1)) ** 2).mean())
            schedule.step()
        self.requires_grad_(False)
        sample = self.at[torch.randperm(len(self.at))[:50_000]]
        errors = (
            self(self.observations[sample], self.actions[sample]) - self.observations[sample + 1, PREDICTED]
        )
        self.noise = errors.std(dim=(0, 1))

    def forward(self, seen: Tensor, actions: Tensor) -> Tensor:
        """The members' predictions."""
        x = ((self.inputs(seen, actions) - self.center) / self.spread).expand(MEMBERS, -1, -1)
        after: Tensor = seen[:, PREDICTED] + self.members(x) * self.scale + self.mean
        return after

    def predicted(self, observations: Any, actions: Any) -> Any:
        """The mean of the members' predictions, as `ibdata.score_model` asks for them."""
        with torch.no_grad():
            return self(torch.from_numpy(observations), torch.from_numpy(actions)).mean(dim=0).numpy()

    def within(self, predicted: Tensor) -> Tensor:
        """Predictions, limited to the range of the data."""
        return torch.minimum(torch.maximum(predicted, self.lowest), self.highest)


class Policy(nn.Module):
    """Actions (n, 3) within [-1, 1] for observations (n, 6 · HISTORY)."""

    def __init__(self, center: Tensor, spread: Tensor) -> None:
        super().__init__()
        self.center, self.spread = center, spread
        sizes = [len(center), *HIDDEN, 3]
        first, second, third = (nn.Linear(*pair) for pair in itertools.pairwise(sizes))
        self.layers = nn.Sequential(first, nn.ReLU(), second, nn.ReLU(), third, nn.Tanh())

    def forward(self, seen: Tensor) -> Tensor:
        """Actions for observations in the units of the data."""
        actions: Tensor = self.layers((seen.float() - self.center) / self.spread)
        return actions


def spread_of(std: Tensor, blind: bool = False) -> Tensor:
    """What inputs are divided by, which hides what is constant in the data, or all setpoints."""
    return torch.from_numpy(seen_spread(std.double().numpy(), blind)).float()


def steered(seen: Tensor, actions: Tensor) -> Tensor:
    """Setpoint, velocity, gain and shift (n, 4) after actions: known, and without noise."""
    moved = seen[:, 1:4] + actions * torch.tensor([D_V, D_G, D_H])
    return torch.cat([seen[:, :1], moved.clamp(0.0, 100.0)], dim=1)


def imagined(policy: Policy, clone: Policy, models: Models, seen: Tensor) -> Tensor:
    """What a policy gets in imagined steps, discounted, less the penalty: the mean over its starts."""
    total = torch.zeros(len(seen))
    for step in range(HORIZON):
        actions = policy(seen)
        members = models(seen, actions)
        distance = ((actions - clone(seen)) ** 2).mean(dim=1)
        total = total + DISCOUNT**step * (reward(members).amin(dim=0) - PENALTY * distance)
        after = models.within(members.mean(dim=0) + models.noise * torch.randn(len(seen), 2))
        seen = torch.cat([steered(seen, actions), after, seen[:, :-VARIABLES]], dim=1)
    return total.mean()


def reward(predicted: Tensor) -> Tensor:
    """The scaled reward of fatigue and consumption (…, 2), Eq. (5) of Hein et al. (2017)."""
    return -REWARD_SCALE * (3.0 * predicted[..., 0] + predicted[..., 1])


def descend(optimizer: torch.optim.Optimizer, loss: Tensor, longest: float | None = None) -> None:
    """Make a step down the gradient of a loss, whose norm is clipped to the longest."""
    optimizer.zero_grad()
    loss.backward()
    if longest is not None:
        nn.utils.clip_grad_norm_([x for group in optimizer.param_groups for x in group["params"]], longest)
    optimizer.step()


def cloned(policy: Policy, models: Models, steps: int) -> None:
    """Train a policy by behavioural cloning: the least squared distance from the actions of the data."""
    optimizer = torch.optim.Adam(policy.parameters(), lr=POLICY_RATE)
    for _ in range(steps):
        at = models.drawn(BATCH)
        descend(optimizer, ((policy(models.observations[at]) - models.actions[at]) ** 2).mean())


class Learned(NamedTuple):
    """What a training makes."""

    models: Models
    clone: Policy
    policy: Policy | None  # None if only the models were wanted


def train(
    rows: Rows, seed: int, before: Learned | None = None, blind: bool = False, with_policy: bool = True
) -> tuple[Learned, dict[str, Any]]:
    """Train models and policy. Return them, and the fields of a baseline about the training.

    Models and clone go on from those of a training `before`, by fewer steps. A `blind` policy does not see
    the setpoint.
    """
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    wall, cpu = time.perf_counter(), time.process_time()
    if before is None:
        models, fewer = Models(rows), 1
        mean, std = (torch.from_numpy(x) for x in rows.moments())
        clone = Policy(mean.float(), spread_of(std, blind))
    else:
        (models, clone), fewer = copy.deepcopy(before[:2]), FINE_TUNING
        models.look_at(rows)
    models.fit(MODEL_STEPS // fewer)
    cloned(clone.requires_grad_(True), models, CLONING_STEPS // fewer)
    clone.requires_grad_(False)
    policy = improved(clone, models) if with_policy else None
    return Learned(models, clone, policy), {
        "training_steps": POLICY_STEPS if with_policy else 0,
        **spent(wall, cpu),
        "hyperparameters": HYPERPARAMETERS,
        "versions": versions("torch", "numpy"),
    }


def improved(clone: Policy, models: Models) -> Policy:
    """The policy that a search by imagined steps makes of a clone."""
    policy: Policy = copy.deepcopy(clone).requires_grad_(True)
    optimizer = torch.optim.Adam(policy.parameters(), lr=POLICY_RATE)
    for _ in range(POLICY_STEPS):
        descend(optimizer, -imagined(policy, clone, models, models.observations[models.drawn(BATCH)]), 1.0)
    policy.requires_grad_(False)
    return policy
