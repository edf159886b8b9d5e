"""Evaluation of policies: returns of new episodes, with standard errors, on common random numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ibdata._numerics.arguments import public
from ibdata._system.memory import refuse_too_much
from ibdata._system.progress import bar
from ibdata.errors import UsageError
from ibdata.evaluation.algorithms import CLAIM, KNOWN, YOURS, LineReturns, algorithms_of
from ibdata.evaluation.baselines import DEFAULTS, NO_CHANGE, Against, baselines_of, form_of
from ibdata.evaluation.play import RETURN_BYTES, Played, checked_discount, play
from ibdata.evaluation.policies import data_notes, is_trained, policies_of
from ibdata.evaluation.results import (
    REFERENCES,
    SCALE,
    differences_of,
    mean_scores,
    notes,
    results_of,
    scores,
    with_references,
)
from ibdata.evaluation.results import Difference as Difference
from ibdata.evaluation.results import Evaluation as Evaluation
from ibdata.evaluation.results import Result as Result
from ibdata.experiment.scenario import other_dynamics, scenario_of
from ibdata.policies import Policy
from ibdata.policies.user_object import ObjectPolicy
from ibdata.views.options import View, view_of


@public
def evaluate(
    policy: Any,
    setpoint: float | Sequence[float] | str | Mapping[str, Any] | None = None,
    *,
    steps: int | None = None,
    discount: float | None = None,
    episodes: int | None = None,
    start: Any = None,
    dynamics: Any = None,
    seed: int | None = None,
    history: int | Mapping[str, int] = 1,
    allow_code: bool = False,
    against: str | None = None,
    progress: bool | None = False,
    view: View = None,
) -> Evaluation:
    """Simulate new episodes with one or several policies and compare their returns.

    The environment uses the same random numbers for all policies, so their differences are paired, episode by
    episode. The return of an episode is the sum over t of discountᵗ times the reward. The policies `random`,
    `optimized` and `expert`, which scores need, are simulated in the same episodes.

    Args:
        policy: one of the following, a mapping of labels to them, or a list of both: a kind such as
            "optimized", a block (mapping, YAML text or file), a `Policy`, an object with `decide(observed)`,
            `act(history, u)` or `predict(observations)`, a `torch.nn.Module`, or any other callable. Modules
            and callables are called as `predict` is: on float32 observations (n, 6 · history), newest first,
            for actions (n, 3). Modules get a tensor, in evaluation mode and without gradients. An object may
            remember and draw as a custom policy may (the page "Custom policies").
        setpoint: one or several numbers, by default 70; "drifting", or {"drifting": [50, 70]} for
            the values at the start.
        steps: steps per episode, by default 100.
        discount: the discount factor, in [0, 1], by default 0.97.
        episodes: episodes per policy and setpoint, by default 100.
        start: the start state, as in an experiment; by default "default".
        dynamics: the dynamics, as in an experiment; by default "siemens".
        seed: the seed of all random numbers, by default 0.
        history: the number of observations that an object sees, if it has no attribute `needs`:
            one number for all, or a mapping of labels to numbers; labels that it lacks get 1.
        allow_code: whether a custom policy that a file names may run.
        against: a shipped experiment, such as "optimized-40" or "random": its baselines are compared with
            the policies (the pages "Baselines" and "The paper's prototypes"). The settings above are then
            those of the set's first evaluation that agrees with the given ones.
        progress: whether to show a bar on stderr; None shows it if stderr is a terminal.
        view: what objects see, the reward, and a cost, as the options of a view (the page
            "Views and costs"), without `reward_scale`. Policies of other kinds always see the six observed
            variables; there are scores only for the classic reward.

    Returns:
        Results per policy and setpoint, and the paired differences of the policies.

    Raises:
        UsageError, ConfigError: an argument is invalid.
        PolicyError: a policy failed, or returned no valid action.
    """
    policies, groups = policies_of(policy, history, allow_code)
    if not policies:
        raise UsageError("policy: found no policy, expected at least one")
    options = view_of(view)
    if options.reward_scale != 1.0:
        raise UsageError("view: found reward_scale, but returns are not scaled; leave it out")
    if not options.is_classic:
        _refuse_unseen(policies)
    classic = options.reward.kind == "classic"
    choices = {"setpoint": setpoint, "steps": steps, "discount": discount, "episodes": episodes}
    choices |= {"start": start, "dynamics": dynamics, "seed": seed}
    chosen = {name: value for name, value in choices.items() if value is not None}
    baselines = Against(None, DEFAULTS, []) if against is None else baselines_of(against, chosen, options)
    settings = {**baselines.settings, **chosen}
    discount = checked_discount(settings.pop("discount"))
    scenario = scenario_of(**settings)
    kinds = () if not classic else REFERENCES if against is None else (*REFERENCES, NO_CHANGE)
    played, references = with_references([*policies.values()], scenario.base, kinds)
    names = [*policies, *(policy.label for policy in played[len(policies) :])]
    cells = scenario.cells(zip(names, played, strict=True))
    refuse_too_much("episodes", RETURN_BYTES * len(cells) * scenario.episodes)
    with bar(progress, len(cells) * scenario.episodes * scenario.steps, "steps") as advance:
        everything = play(scenario, cells, discount, advance, options)

    budget = None if options.cost is None else options.cost.budget
    labels, of_policies = list(policies), Played._make(part[: len(policies)] for part in everything)
    points = scenario.points
    at_references = everything.discounted[references]
    scored = scores(of_policies.discounted, at_references[: len(REFERENCES)])
    all_notes = [*notes(scenario.episodes, points, scored[0], classic)]
    for (label, policy), notes_of_policy in zip(policies.items(), of_policies.notes, strict=True):
        all_notes += [f"{label}: {note}" for note in (*notes_of_policy, *other_dynamics(policy, scenario))]
    if kinds:
        all_notes += [f"expert_score: {note}" for note in other_dynamics(scenario.expert, scenario)]
    members = {label: {name: policies[name] for name in names} for label, names in groups.items()}
    yours, returns = [], iter(of_policies.discounted)
    for label, of_label in members.items():
        of_group = np.array([next(returns) for _ in of_label])
        yours.append(LineReturns(label, YOURS, any(map(is_trained, of_label.values())), of_group))
        all_notes += data_notes(label, list(of_label.values()), baselines.set)
    again = dict(zip(kinds, at_references, strict=True))
    others = [LineReturns(kind, KNOWN, False, of_kind[None]) for kind, of_kind in again.items()]
    others += baselines.lines(again)
    sources = list(dict.fromkeys(group.source for group in others))
    others.sort(key=lambda group: sources.index(group.source))
    of_algorithms = against is not None or len(groups) < len(policies)
    if of_algorithms:
        all_notes += [CLAIM, baselines.protocol(settings | {"discount": discount})]
    lines = [*yours, *others]
    return Evaluation(
        results_of(labels, points, of_policies, scored, scenario.steps, budget),
        differences_of(yours, others if of_algorithms else [], points, of_algorithms),
        SCALE if any(score.score is not None for score in scored[0]) else None,
        of_policies.discounted,
        scenario.steps,
        discount,
        all_notes,
        algorithms_of(
            lines, points, [mean_scores(line, points, at_references[: len(REFERENCES)]) for line in lines]
        ),
        {**form_of(settings | {"discount": discount}), "against": baselines.set, "view": options.changed()},
        members,
    )


def _refuse_unseen(policies: Mapping[str, Policy]) -> None:
    """Raise UsageError for a view that no object sees, or one of them not."""
    if not any(isinstance(policy, ObjectPolicy) for policy in policies.values()):
        raise UsageError(
            "view: found one, but no object that could see it: policies of ibdata see the six observed "
            "variables; leave it out, or give a function, a module or an object"
        )
    for label, policy in policies.items():
        if not isinstance(policy, ObjectPolicy) and any(policy.everywhere(ObjectPolicy)):
            raise UsageError(
                f"view: found {label}, an object within a policy of ibdata, which would see the six observed "
                "variables; evaluate it without the view, or write an object that does what both do"
            )
