"""Off-policy evaluation: the return of a policy from the data of another one, by importance weights."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dataset.reader import Place, opened
from ibdata.dataset.tabular import Table, Tabular
from ibdata.errors import UsageError
from ibdata.evaluation.discount import checked_discount
from ibdata.evaluation.overlap import check_support
from ibdata.evaluation.policies import loaded, policy_of, refuse_unused
from ibdata.evaluation.recorded import parts_of, read
from ibdata.experiment.code_comparison import refuse_changed
from ibdata.experiment.code_record import provenance
from ibdata.experiment.custom_code import consented_spec, customs_in
from ibdata.numerics.confidence import estimate
from ibdata.writing.planned import refuse_other_plan

if TYPE_CHECKING:
    import pandas as pd

Floats = npt.NDArray[np.float64]
LEAST_EFFECTIVE = 100.0  # episodes, below which the result has a warning
METHODS = ("ordinary", "per decision", "weighted")


class Estimated(NamedTuple):
    """The target's mean return as a method estimates it, with standard error and 95 % interval.

    If the weights of a step are all 0, the weighted estimate is None. The last two are None for one episode.
    """

    method: str
    mean_return: float | None
    standard_error: float | None
    interval: tuple[float, float] | None


@dataclasses.dataclass(frozen=True, repr=False)
class Importance(Tabular):
    """Estimates of a policy's return from the data of others, and the weights behind them.

    `ratios` are those of the densities of the target and the behaviour, `weights` their products from the
    start of the episode, and `rewards` are discounted. `effective` is the effective sample size (Σw)²/Σw² of
    each step. `notes` warn of what makes the estimates doubtful, a line for each reason.
    """

    policy: str
    results: list[Estimated]
    ratios: Floats  # (episodes, steps)
    weights: Floats  # (episodes, steps)
    rewards: Floats  # (episodes, steps)
    effective: Floats  # (steps,)
    discount: float
    notes: list[str]

    def tables(self) -> list[Table]:
        """The estimates, and below them the mean of the last weights and their effective sample size."""
        mean, error, _ = estimate([self.weights[:, -1]])
        spread = "" if error is None else f" ± {error:.3g}"
        said = [
            f"policy: {self.policy}; discount: {self.discount:g}",
            f"mean of the last weights: {mean:.4g}{spread}, expected 1",
            f"effective sample size: {self.effective[-1]:,.1f} of {len(self.weights):,} episodes",
        ]
        return [Table(Estimated._fields, self.results, [*said, *self.notes])]

    def to_pandas(self) -> pd.DataFrame:
        """The estimates, a row each, as a pandas DataFrame."""
        import pandas as pd

        return pd.DataFrame(self.results, columns=list(Estimated._fields))


def importance(
    ds: Place,
    target: Any,
    *,
    discount: float = 0.97,
    split: str | None = None,
    setpoint: float | Sequence[float] | None = None,
    policy: str | Sequence[str] | None = None,
    history: int = 1,
    allow_code: bool = False,
) -> Importance:
    """Estimate the return of a policy from the data of other policies, by importance sampling.

    With w_t = Π_{k ≤ t} π(a_k)/β(a_k), the weight of step t, and T the last step, over the episodes:

        ordinary       mean of w_T Σ_t γᵗ r_t
        per decision   mean of Σ_t γᵗ w_t r_t
        weighted       Σ_t γᵗ mean of w_t r_t / mean of w_t

    The first two are unbiased, the third has a little bias and much less variance. Sources: Precup, Sutton
    and Singh 2000, Eligibility traces for off-policy policy evaluation; for the third, which is also known as
    consistent weighted per-decision importance sampling, Thomas 2015, Safe reinforcement learning.

    The densities of the behaviour, β, are the `action_log_prob` of the data, whose policies must be able to
    take every action of the target. The density of the target, π, is that given the recorded observations,
    actions and what it remembers of them.

    Args:
        ds: the dataset, or its folder or URL.
        target: the policy to be evaluated: a kind, a block, a file, a `Policy`, or an object with `act` and
            `log_prob`, as in `evaluate`. An object or a policy of your own may say its `support`.
        discount: the discount factor γ, in [0, 1].
        split: only episodes of this split.
        setpoint: only episodes at this setpoint, or at these; moving ones count by their first value.
        policy: only episodes of the policy with this label, or with these.
        history: the number of observations that an object sees, if it has no `history_length`.
        allow_code: whether custom policies, of the data or in a file, may run.

    Returns:
        The estimates, with the ratios, the weights and their effective sample size at each step.

    Raises:
        UsageError: a policy of the data cannot take all actions of the target, a density is not known, the
            episodes have different lengths, or an argument is invalid.
        PolicyError: the target failed, or returned no valid density.
        DatasetError: a file is missing or damaged.
    """
    discount = checked_discount(discount)
    wanted = policy_of(target, history, allow_code)
    refuse_unused(history, [wanted])
    ds = opened(ds)
    spec = consented_spec(ds, ds.manifest_model, allow_code)
    refuse_other_plan(spec, ds.manifest_model)
    chosen = ds.table(["episode", "step"], split, setpoint=setpoint, policy=policy)
    episodes = chosen["episode"].to_numpy()[chosen["step"].to_numpy() == 0]
    if not len(episodes):
        raise UsageError("split, setpoint, policy: found no episode that meets all, expected at least one")
    found = list(parts_of(spec, episodes))
    lengths = sorted({part.steps for part in found})
    if len(lengths) > 1:
        raise UsageError(f"steps: found episodes of {lengths[0]} and of {lengths[-1]}, expected one length")
    behaviours = {id(part.behaviour): part.behaviour for part in found}.values()
    with loaded([wanted, *behaviours]):
        customs = [custom for behaviour in behaviours for custom in customs_in(behaviour)]
        refuse_changed(ds.manifest_model.code, provenance(customs), ds.place)
        notes = [note for behaviour in behaviours for note in check_support(behaviour, wanted, lengths[0])]
        ratios, rewards = (
            np.concatenate(arrays)
            for arrays in zip(*(read(ds, spec, part, wanted) for part in found), strict=True)
        )
        refuse_changed(ds.manifest_model.code, provenance(customs), ds.place)  # what was imported late
    return of_ratios(wanted.label, ratios, rewards, discount, list(dict.fromkeys(notes)))


def of_ratios(
    label: str, log_ratios: Floats, rewards: Floats, discount: float, notes: Sequence[str] = ()
) -> Importance:
    """The estimates from the logarithms of the ratios and the rewards, both (episodes, steps)."""
    logs = np.cumsum(log_ratios, axis=1)
    greatest = logs.max(axis=0)
    weights = np.exp(logs)
    relative = np.exp(logs - np.where(np.isfinite(greatest), greatest, 0.0))  # of long episodes, not all 0
    paid = rewards * discount ** np.arange(rewards.shape[1])
    squares = (relative**2).sum(axis=0)
    effective = np.divide(relative.sum(axis=0) ** 2, squares, out=np.zeros(len(squares)), where=squares > 0.0)
    found = [
        Estimated(METHODS[0], *estimate([weights[:, -1] * paid.sum(axis=1)])),
        Estimated(METHODS[1], *estimate([(weights * paid).sum(axis=1)])),
        _weighted(relative, paid),
    ]
    warned = list(notes)
    if effective[-1] < LEAST_EFFECTIVE:
        warned.append(
            f"warning: an effective sample size of {effective[-1]:,.1f} is below {LEAST_EFFECTIVE:g}; trust "
            "neither estimates nor intervals"
        )
    if not effective[-1]:
        warned.append(
            f"warning: all weights are 0 from step {int((effective == 0.0).argmax())} on, so the ordinary "
            "estimate is 0, and the one per decision leaves out the rewards from there on"
        )
    return Importance(label, found, np.exp(log_ratios), weights, paid, effective, discount, warned)


def _weighted(weights: Floats, paid: Floats) -> Estimated:
    """The weighted estimate, from weights up to a factor. The error is that of the delta method."""
    means = weights.mean(axis=0)
    if not means.all():
        return Estimated(METHODS[2], None, None, None)
    shares = weights / means
    expected = (shares * paid).mean(axis=0)
    return Estimated(METHODS[2], *estimate([expected.sum() + (shares * (paid - expected)).sum(axis=1)]))
