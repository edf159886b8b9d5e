"""The experiment of docs/experiments.md in which every option is explained."""

EXPLAINED = """\
## An example with its options explained

```yaml
# explained.yaml
name: explained
dynamics: siemens               # or paper, or {base: paper, eta_mean: 0.1}
setpoints: [20, 70]             # or a number, {start: 10, stop: 100, step: 10}, drifting, {drifting: 50}
policies:
  - kind: random                # uniform on [-1, 1]³
  - kind: safe                  # velocity and gain are steered back when they leave [40, 60]
  - kind: constant              # the same action at every step
    action: [0, 0.5, 0]
  - kind: bad                   # velocity, gain and shift to 100; kind: mediocre steers them to 25
  - kind: epsilon_greedy        # random actions now and then around another policy
    base: {kind: optimized}     # a good formula of delayed observations
    epsilon: 0.2                # share of random actions; per_dimension: true draws for each number
    name: explored              # the label in the data; without it, the kind
  - kind: gaussian              # normal noise around a policy that draws nothing itself
    base: {kind: mediocre}
    scale: 0.1                  # standard deviation
episodes: 10                    # of each setpoint and policy
steps: 1000
start: default                  # velocity, gain, shift = 50; or uniform, or {burn_in: [15, 64]} random steps
seed: 0
output:
  dtype: float32                # or float64
  latent: true                  # or false, full (with derived values), next (also of t + 1)
  shard_rows: 1000000           # rows per file
splits:                         # named sets of episodes, each made of whole files
  train: {setpoint: 20, episodes: 8}   # the first 8 of each policy; or {start: 0, stop: 7}, or first 80%
  test: {setpoint: 70, policy: safe}
licence: CC-BY-4.0              # of the dataset: an SPDX expression, such as MIT OR Apache-2.0
```

```sh
ibdata config validate explained.yaml
```

`kind: custom` is [your own code](tasks.md#use-your-own-policy).

`licence` is the licence of the dataset, by default CC-BY-4.0. It is an [SPDX
expression](https://spdx.org/licenses/): 2 to 200 letters, digits, spaces and `. + - ( )`. ibdata does not
check that there is such a licence; `LicenseRef-` and a word name a licence of your own. The
[card](dataset-format.md#the-card) of the dataset names the licence. Rows and content root do not depend on
it. A `meta/experiment.yaml` without it means the default licence.

"""
