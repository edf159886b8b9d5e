"""Figures of the paper, one per module, with `draw`, the `SIZE` in inches and the default `SEED`."""
