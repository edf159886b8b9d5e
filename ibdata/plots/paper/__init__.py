"""Figures of the paper, one per module, with `draw(figure, dynamics, seed)` and the default `SEED`."""
