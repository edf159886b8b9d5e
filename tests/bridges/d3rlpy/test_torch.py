"""Modules of torch are evaluated as they are, and its loaders read windows."""

import numpy as np
import pytest
import torch

import ibdata
from ibdata.errors import PolicyError

FEW = {"episodes": 5, "steps": 20}


class Net(torch.nn.Module):
    """A small network, random in training only, that looks at what it is given."""

    def __init__(self, inputs=6, outputs=3):
        super().__init__()
        torch.manual_seed(0)
        first, last = torch.nn.Linear(inputs, 8), torch.nn.Linear(8, outputs)
        self.body = torch.nn.Sequential(first, torch.nn.Dropout(0.5), torch.nn.Tanh(), last)

    def forward(self, observations):
        assert observations.dtype == torch.float32
        assert not torch.is_grad_enabled()
        return self.body(observations / 100.0)


def test_a_module_gets_the_returns_of_the_function_that_it_is():
    net = Net()
    net.body[1].eval()
    first, bias, last, end = (p.detach().numpy().astype(np.float64) for p in net.parameters())

    def by_hand(observations):
        return np.tanh(observations / 100.0 @ first.T + bias) @ last.T + end

    found = ibdata.evaluate({"net": net, "by hand": by_hand}, **FEW)
    np.testing.assert_allclose(found.returns[0], found.returns[1], rtol=1e-4)
    with pytest.raises(PolicyError, match=r"mat1 and mat2 .*; it was given observations \(32, 12\)"):
        ibdata.evaluate(net, history=2, **FEW)
    assert [part.training for part in net.body] == [True, False, True, True]
    assert torch.is_grad_enabled()


def test_tensors_of_every_kind_are_actions():
    def answer(kind):
        return lambda seen: torch.zeros(len(seen), 3, dtype=kind, requires_grad=kind.is_floating_point)

    kinds = (torch.float64, torch.float32, torch.bfloat16, torch.int64)
    found = ibdata.evaluate([*map(answer, kinds), "constant"], **FEW)
    assert (found.returns == found.returns[-1]).all()


def test_a_loader_reads_windows_as_the_arrays_show_them(tmp_path):
    """Also with torch's own collation, which asks for single transitions, and in other processes."""
    given = {"name": "x", "setpoints": 70, "policies": ["random"], "episodes": 3, "steps": 40}
    data = ibdata.generate(given, tmp_path / "data", workers=1)
    options = {"history": 5, "view": {"actions": True}}
    windows, arrays = data.windows(**options), data.arrays(**options)
    for how in ({"collate_fn": windows.collate}, {}, {"collate_fn": windows.collate, "num_workers": 2}):
        batches = list(torch.utils.data.DataLoader(windows, batch_size=16, **how))
        for name in windows[0]:
            found = torch.cat([batch[name] for batch in batches])
            assert found.numpy().tolist() == arrays[name].tolist()
