"""One figure a module: `draw` into a matplotlib figure of `SIZE` inches, by default with `SEED`."""
